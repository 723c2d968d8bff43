"""Streamed execution for an hour: how even the stream of poses is, and whether the bridge's memory grows."""

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from egophys_ros_common.processes import Client

from benchmarks.fault_rig import FaultRig, loopback_addresses, plan_through

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
    gaps: list[np.ndarray] = []
    memory: list[float] = []
    with TemporaryDirectory() as folder:
        client = Client()
        rig = FaultRig(client, Path(folder), loopback_addresses()())
        try:
            end = time.monotonic() + 3600.0 * hours
            while time.monotonic() < end or len(memory) <= WARM_UP:
                ended = client.result(rig.send(MINUTE))
                if not ended.result.success:
                    raise RuntimeError(f"plan {len(memory)}: {ended.result.message}")
                memory.append(rig.bridge.memory_mb())
                gaps.append(_gaps(Path(folder) / "wire.jsonl"))
                longest_ms = 1e3 * gaps[-1].max()
                print(f"{len(memory)} plans, {memory[-1]:.1f} MB, longest gap {longest_ms:.1f} ms", flush=True)
        finally:
            rig.close()
            client.close()
    every = np.concatenate(gaps)
    return {
        "stream_hours": float(every.sum() / 3600.0),
        "streamed_poses": len(every),
        "median_gap_ms": float(1e3 * np.median(every)),
        "gaps_above_20_ms": int((every > 0.02).sum()),
        "worst_gap_ms": float(1e3 * every.max()),
        "memory_growth_mb": memory[-1] - memory[WARM_UP],
    }


def _gaps(wire: Path) -> np.ndarray:
    """Seconds between streamed poses, as they came to the emulator; its lines are dropped once they are read."""
    time.sleep(1.2)  # the emulator flushes each second
    lines = [json.loads(text) for text in wire.read_text().splitlines()]
    wire.write_text("")
    stamps = np.array([line["t"] for line in lines if line["name"] == STREAMED])
    between = np.diff(stamps)
    return between[between < PAUSE_S]
