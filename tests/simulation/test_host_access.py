import numpy as np
import warp as wp

from egophys_core.simulation.host_access import HostAccess


@wp.kernel
def double(values: wp.array(dtype=float)):
    row = wp.tid()
    values[row] = 2.0 * values[row]


def test_host_and_kernels_see_what_the_other_wrote():
    array = wp.zeros(3, dtype=float, device="cpu")
    host = HostAccess(array)
    host.write(np.float32([1.0, 2.0, 3.0]))
    wp.launch(double, 3, inputs=[array], device="cpu")
    assert host.read().tolist() == [2.0, 4.0, 6.0]
    host.write(host.read() + 1.0)
    assert array.numpy().tolist() == [3.0, 5.0, 7.0]
