"""The codebook of a batch on a device, asked as every second frame of a video begins."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from egophys_core.lanes import Lanes, group_count, pack, unpack
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation.attachments import Attachments
from egophys_core.simulation.batch import BatchCodebook, RolloutBatch
from egophys_core.simulation.terms.codebook import CodebookArrays, predict_stiffness
from egophys_core.simulation.terms.codebook_network import OUTPUT_BLOCK, UNIT_BLOCK, NetworkArrays
from egophys_core.simulation.terms.springs import SpringArrays
from egophys_core.twin.spring_features import STATIC


def asked_frames(times: np.ndarray, longest_held: float) -> np.ndarray:
    """[F - 1] int: for every frame that one as which begins the codebook is asked for it, if answers serve so long.

    It depends on times [F] in seconds alone, so that a rollout does not depend on what else is in its batch.
    """
    asked = np.zeros(len(times) - 1, int)
    for frame in range(1, len(asked)):
        held = times[frame + 1] - times[asked[frame - 1]] <= longest_held
        asked[frame] = asked[frame - 1] if held else frame
    return asked


class DeviceCodebook:
    """Sets the stiffness of a batch's springs."""

    def __init__(self, batch: RolloutBatch, learned: BatchCodebook, device: str) -> None:
        self.batch, self.device = batch, device
        self.groups, self.nodes = group_count(batch.count), batch.positions.shape[1]
        # A CPU runs threads one after the other, so one for each lane group does.
        self.rows = self.nodes if wp.get_device(device).is_cpu else 1
        self.asked = asked_frames(batch.controls[0].times, learned.longest_held)
        """[F - 1] as which begins it is asked for each frame of the batch."""
        self.network = _network(learned, device)
        self.arrays = _arrays(batch, learned, device)
        self._attachments: Sequence[Attachments] = ()
        self.largest_factors = np.ones(batch.count)
        """[K] by how much a spring of each rollout is stiffer than its anchor now, at most; 1 where none is.

        Of a rollout that diverged it means nothing, and is 1.
        """
        self._largest = wp.zeros((self.groups, -(-self.nodes // self.rows)), dtype=Lanes, device=device)

    def set_stiffness(
        self,
        state: StateArrays,
        parameters: ParameterArrays,
        springs: SpringArrays,
        attachments: Sequence[Attachments],
    ) -> None:
        """Write into `springs` how stiff each is in this state, with these contacts of each rollout."""
        if attachments is not self._attachments:
            self.arrays.held.assign(pack(held_nodes(attachments, self.nodes)))
            self._attachments = attachments
        wp.launch(
            predict_stiffness,
            dim=self._largest.shape,
            inputs=[
                self.rows,
                self.nodes,
                state,
                parameters,
                self.network,
                self.arrays,
                springs,
                springs.stiffness,
                self._largest,
            ],
            device=self.device,
        )
        largest = unpack(self._largest.numpy(), self.batch.count).max(axis=1, initial=1.0)
        self.largest_factors = np.where(np.isfinite(largest), largest, 1.0)


def held_nodes(attachments: Sequence[Attachments], nodes: int) -> np.ndarray:
    """[K, N] float32: 1 for nodes that a hand holds, else 0."""
    held = np.zeros((len(attachments), nodes), np.float32)
    for row, each in enumerate(attachments):
        held[row, each.nodes[each.holds]] = 1.0
    return held


def _network(learned: BatchCodebook, device: str) -> NetworkArrays:
    """A network with scales and temperature put into its weights."""
    codebook, count = learned.codebook, len(STATIC)
    units = -len(codebook.hidden_bias) % UNIT_BLOCK
    scaled = np.pad(codebook.hidden_weights / codebook.scale, ((0, units), (0, 0)))
    bias = np.pad(codebook.hidden_bias, (0, units)) - scaled @ codebook.centre
    alike = bool((learned.features == learned.features[:1]).all())
    features = learned.features[0] if alike else learned.features
    limited = np.clip(features, codebook.low[:count], codebook.high[:count])
    of_graph = limited @ scaled[:, :count].T + bias
    temperature = codebook.temperature[0] if codebook.size else 1.0
    outputs = codebook.head_bias.shape[1]
    lacking = -outputs % OUTPUT_BLOCK
    heads = np.pad(codebook.head_weights / temperature, ((0, 0), (0, lacking), (0, units)))
    arrays = NetworkArrays()
    arrays.hidden_count, arrays.output_count = len(bias), outputs
    arrays.has_prototypes = int(codebook.size > 0)
    arrays.alike = int(alike)
    if alike:
        arrays.of_graph = _floats(of_graph, device)
    else:
        arrays.of_graphs = wp.array(pack(of_graph), dtype=Lanes, device=device)
    for name, values in (
        ("by_dynamic", scaled[:, count:]),
        ("heads", heads.reshape(2, -1, OUTPUT_BLOCK, len(bias)).swapaxes(2, 3)),
        ("head_bias", np.pad(codebook.head_bias / temperature, ((0, 0), (0, lacking)))),
        ("prototypes", codebook.prototypes if codebook.size else np.zeros((2, 1))),
    ):
        setattr(arrays, name, _floats(values, device))
    return arrays


def _arrays(batch: RolloutBatch, learned: BatchCodebook, device: str) -> CodebookArrays:
    """Limits, anchors and holds, of which there are none yet."""
    arrays, count = CodebookArrays(), len(STATIC)
    arrays.low, arrays.high = (
        _floats(limits[count:], device) for limits in (learned.codebook.low, learned.codebook.high)
    )
    arrays.anchors = wp.array(pack(batch.stiffness), dtype=Lanes, device=device)
    used = (batch.stiffness > 0.0) & learned.used[:, None]
    arrays.used = wp.array(pack(used.astype(np.float32)), dtype=Lanes, device=device)
    arrays.held = wp.zeros((group_count(batch.count), batch.positions.shape[1]), dtype=Lanes, device=device)
    return arrays


def _floats(values: np.ndarray, device: str) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=float, device=device)
