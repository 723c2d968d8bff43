"""The network of a codebook for one spring of all rollouts of a lane group, in C++.

In Warp's language the same takes three times as long on a CPU: its compiler does not see that the lanes of the inner
loops are one vector.
"""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.twin.codebook import MOST_PROTOTYPES, MOST_UNITS

OUTPUT_BLOCK, UNIT_BLOCK = 4, 2
"""Outputs and hidden units that are computed together; weights are filled up to multiples of them."""


@wp.struct
class NetworkArrays:
    """Weights that are ready to be used, and what the graph gives to the hidden units."""

    hidden_count: int
    output_count: int
    """Outputs of a head: prototypes of a bank, or 1 where there are none."""
    has_prototypes: int
    alike: int
    """Whether all rollouts have the same graph."""
    of_graph: wp.array2d(dtype=float)
    """[E, H] what static features and bias give to the hidden units, if the graphs are alike."""
    of_graphs: wp.array3d(dtype=Lanes)
    """[G, E, H] the same if they are not."""
    by_dynamic: wp.array2d(dtype=float)
    """[H, 6] weights of the dynamic features, over their scale."""
    heads: wp.array4d(dtype=float)
    """[2, blocks of outputs, H, 4] over the temperature, tension first."""
    head_bias: wp.array2d(dtype=float)
    """[2, O filled up] likewise."""
    prototypes: wp.array2d(dtype=float)
    """[2, O] offsets of the logarithm of stiffness."""


_SIZES = f"""
    #pragma clang fp contract(fast)
    constexpr int LANES = {LANES}, UNITS = {MOST_UNITS}, PROTOTYPES = {MOST_PROTOTYPES};
    constexpr int OUTPUT_BLOCK = {OUTPUT_BLOCK};
"""

# exp(x) = 2^n exp(r) with |r| <= ln(2) / 2; the polynomial is that of Cephes' expf, which errs by 2 in the last digit.
# x is limited to where 2^n is a float.
_NETWORK = """
    struct Exponential {
        static CUDA_CALLABLE inline float of(float x) {
            x = x < -80.0f ? -80.0f : (x > 80.0f ? 80.0f : x);
            const float shifted = x * 1.44269504f + 12582912.0f;
            const float n = shifted - 12582912.0f;
            const float r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
            float p = 1.9875691500e-4f;
            p = p * r + 1.3981999507e-3f;
            p = p * r + 8.3334519073e-3f;
            p = p * r + 4.1665795894e-2f;
            p = p * r + 1.6666665459e-1f;
            p = p * r + 5.0000001201e-1f;
            p = p * r * r + r + 1.0f;
            union { int bits; float value; } power;
            power.bits = (wp::cast_int(n) + 127) << 23;
            return p * power.value;
        }
    };
    const int hidden = network.hidden_count, outputs = network.output_count;
    const float* by_dynamic = &wp::index(network.by_dynamic, 0, 0);
    float value[UNITS][LANES];
    if (network.alike) {
        const float* of_graph = &wp::index(network.of_graph, spring, 0);
        for (int unit = 0; unit < hidden; ++unit)
            for (int lane = 0; lane < LANES; ++lane)
                value[unit][lane] = of_graph[unit];
    } else {
        const wp::vec_t<LANES, float>* of_graph = &wp::index(network.of_graphs, group, spring, 0);
        for (int unit = 0; unit < hidden; ++unit)
            for (int lane = 0; lane < LANES; ++lane)
                value[unit][lane] = of_graph[unit].c[lane];
    }
    for (int unit = 0; unit < hidden; ++unit) {
        const float* w = by_dynamic + 6 * unit;
        for (int lane = 0; lane < LANES; ++lane) {
            const float total = value[unit][lane] + w[0] * stretch.c[lane] + w[1] * size.c[lane]
                + w[2] * rate.c[lane] + w[3] * vertical.c[lane] + w[4] * height.c[lane] + w[5] * held.c[lane];
            value[unit][lane] = total > 0.0f ? total : 0.0f;
        }
    }
    float scores[PROTOTYPES][LANES] = {};
    float pulled = 0.0f;
    for (int lane = 0; lane < LANES; ++lane)
        pulled += stretched.c[lane];
    for (int bank = 0; bank < 2; ++bank) {
        // Where all lanes are pulled, or all pressed, the other head is not asked.
        if (pulled == (bank == 0 ? 0 : LANES))
            continue;
        for (int k = 0; k < outputs; k += OUTPUT_BLOCK) {
            const float* w = &wp::index(network.heads, bank, k / OUTPUT_BLOCK, 0, 0);
            // Even and odd units have sums of their own, so that one addition need not wait for the last.
            float sums[2][OUTPUT_BLOCK][LANES];
            for (int j = 0; j < OUTPUT_BLOCK; ++j)
                for (int lane = 0; lane < LANES; ++lane) {
                    sums[0][j][lane] = wp::index(network.head_bias, bank, k + j);
                    sums[1][j][lane] = 0.0f;
                }
            for (int unit = 0; unit < hidden; unit += 2)
                for (int odd = 0; odd < 2; ++odd)
                    for (int j = 0; j < OUTPUT_BLOCK; ++j)
                        for (int lane = 0; lane < LANES; ++lane)
                            sums[odd][j][lane] += w[OUTPUT_BLOCK * (unit + odd) + j] * value[unit + odd][lane];
            for (int j = 0; j < OUTPUT_BLOCK; ++j)
                for (int lane = 0; lane < LANES; ++lane)
                    if ((stretched.c[lane] > 0.5f) == (bank == 0))
                        scores[k + j][lane] = sums[0][j][lane] + sums[1][j][lane];
        }
    }
    float largest[LANES], total[LANES] = {}, weighted[LANES] = {};
    for (int k = 0; k < outputs; ++k)
        for (int lane = 0; lane < LANES; ++lane) {
            const float score = scores[k][lane];
            largest[lane] = k == 0 || score > largest[lane] ? score : largest[lane];
        }
    for (int k = 0; network.has_prototypes && k < outputs; ++k) {
        const float longer = wp::index(network.prototypes, 0, k), shorter = wp::index(network.prototypes, 1, k);
        for (int lane = 0; lane < LANES; ++lane) {
            const float weight = Exponential::of(scores[k][lane] - largest[lane]);
            total[lane] += weight;
            weighted[lane] += weight * (stretched.c[lane] > 0.5f ? longer : shorter);
        }
    }
    wp::vec_t<LANES, float> factor;
    for (int lane = 0; lane < LANES; ++lane) {
        float offset = network.has_prototypes ? weighted[lane] / total[lane] : scores[0][lane];
        offset = offset < -most ? -most : (offset > most ? most : offset);
        factor.c[lane] = Exponential::of(used.c[lane] * offset);
    }
    return factor;
"""


@wp.func_native(_SIZES + _NETWORK)
def stiffness_factor(
    network: NetworkArrays,
    group: int,
    spring: int,
    stretch: Lanes,
    size: Lanes,
    rate: Lanes,
    vertical: Lanes,
    height: Lanes,
    held: Lanes,
    stretched: Lanes,
    used: Lanes,
    most: float,
) -> Lanes:
    """By how much a spring with these dynamic features is stiffer than its anchor.

    Args:
        stretched: 1 where tension's bank is asked, else 0.
        used: 1 where the codebook is, else 0.
        most: the largest offset of the logarithm.
    """
    ...
