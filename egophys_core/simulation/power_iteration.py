"""Kernels that look for the largest eigenvalue of M^-1 L, L the Laplacian of a spring graph."""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.simulation.terms.springs import SpringArrays


@wp.func
def add_laplacian_rows(
    group: int,
    springs: SpringArrays,
    weights: wp.array2d(dtype=Lanes),
    nodes: int,
    vector: wp.array2d(dtype=Lanes),
    product: wp.array2d(dtype=Lanes),
):
    """Add L vector to `product`, L the graph's Laplacian; ends that are controller points do not move."""
    for node in range(nodes):
        here = vector[group, node]
        total = Lanes()
        for spring in range(springs.starts[node], springs.starts[node + 1]):
            other = springs.ends[spring]
            if other < nodes:
                flow = wp.cw_mul(weights[group, spring], here - vector[group, other])
                total += flow
                product[group, other] -= flow
            else:
                total += wp.cw_mul(weights[group, spring], here)
        product[group, node] += total


@wp.kernel(enable_backward=False)
def iterate_power(
    iterations: int,
    damping: bool,
    springs: SpringArrays,
    grips: SpringArrays,
    masses: wp.array2d(dtype=Lanes),
    vector: wp.array2d(dtype=Lanes),
    product: wp.array2d(dtype=Lanes),
    largest: wp.array(dtype=Lanes),
):
    """Power iteration on M^-1 L for one lane group; dim = G. `product` starts as 0."""
    group = wp.tid()
    nodes = masses.shape[1]
    for _iteration in range(iterations):
        if damping:
            add_laplacian_rows(group, springs, springs.damping, nodes, vector, product)
            add_laplacian_rows(group, grips, grips.damping, nodes, vector, product)
        else:
            add_laplacian_rows(group, springs, springs.stiffness, nodes, vector, product)
            add_laplacian_rows(group, grips, grips.stiffness, nodes, vector, product)
        # With |x|_M = 1 the norm |M^-1 L x|_M is between the Rayleigh quotient and the largest eigenvalue.
        squared = Lanes()
        for node in range(nodes):
            mass = masses[group, node]
            image = wp.cw_div(product[group, node], mass)
            squared += wp.cw_mul(mass, wp.cw_mul(image, image))
            vector[group, node] = image
            product[group, node] = Lanes()
        norm = Lanes()
        scale = Lanes()
        for lane in range(LANES):
            norm[lane] = wp.sqrt(squared[lane])
            scale[lane] = 1.0 / wp.max(norm[lane], 1.0e-30)
        for node in range(nodes):
            vector[group, node] = wp.cw_mul(scale, vector[group, node])
        largest[group] = norm
