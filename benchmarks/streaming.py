"""Streamed execution for an hour: how even the stream of poses is, and whether the bridge's memory grows."""

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from egophys_ros_common.processes import Client

from benchmarks.fault_rig import FaultRig, loopback_addresses, plan_through
from benchmarks.machine_gaps import watched_machine

STREAMED = "move_servo_cart"
PAUSE_S = 0.09
"""The arm stands still for longer between plans, and between approach and plan; no gap in a stream is meant there."""
LEG_S, LEGS = 2.0, 30
"""A plan of a minute: to and fro."""
WARM_UP = 2
"""Plans after which memory is compared: the first ones fill caches."""

MINUTE = plan_through(
    [[-0.1, 0.1 if leg % 2 else -0.1, 0.12] for leg in range(LEGS + 1)], [LEG_S * leg for leg in range(LEGS + 1)]
)


def measure(hours: float) -> dict[str, Any]:
    """Stream plans of a minute one after another for some hours, through the bridge's action, on this machine."""
    stamps: list[np.ndarray] = []
    memory: list[float] = []
    with watched_machine() as machine, TemporaryDirectory() as folder:
        client = Client()
        rig = FaultRig(client, Path(folder), loopback_addresses()())
        try:
            end = time.monotonic() + 3600.0 * hours
            while time.monotonic() < end or len(memory) <= WARM_UP:
                ended = client.result(rig.send(MINUTE))
                if not ended.result.success:
                    raise RuntimeError(f"plan {len(memory)}: {ended.result.message}")
                memory.append(rig.bridge.memory_mb())
                stamps.append(_stamps(Path(folder) / "wire.jsonl"))
                longest_ms = 1e3 * max(gap for gap in np.diff(stamps[-1]) if gap < PAUSE_S)
                print(f"{len(memory)} plans, {memory[-1]:.1f} MB, longest gap {longest_ms:.1f} ms", flush=True)
        finally:
            rig.close()
            client.close()
    since, until = np.concatenate([np.stack([each[:-1], each[1:]]) for each in stamps], axis=1)
    gaps = until - since
    since, until, gaps = (values[gaps < PAUSE_S] for values in (since, until, gaps))
    long = gaps > 0.02
    ours = long.copy()
    ours[long] = ~machine.overlap(since[long], until[long])
    return {
        "stream_hours": float(gaps.sum() / 3600.0),
        "streamed_poses": len(gaps),
        "median_gap_ms": float(1e3 * np.median(gaps)),
        "gaps_above_20_ms": int(long.sum()),
        "gaps_above_20_ms_of_ours": int(ours.sum()),
        "worst_gap_ms": float(1e3 * gaps.max()),
        "worst_gap_of_ours_ms": float(1e3 * gaps[ours | ~long].max()),
        "memory_growth_mb": memory[-1] - memory[WARM_UP],
    }


def _stamps(wire: Path) -> np.ndarray:
    """When streamed poses came to the emulator, seconds since the epoch; its lines are dropped once they are read."""
    time.sleep(1.2)  # the emulator flushes each second
    lines = [json.loads(text) for text in wire.read_text().splitlines()]
    wire.write_text("")
    return np.array([line["t"] for line in lines if line["name"] == STREAMED])
