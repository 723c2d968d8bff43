"""`egophys calibrate PAIRS.csv --out YAML`."""

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import print_json, print_table
from egophys_core.files import require_writable

if TYPE_CHECKING:
    from egophys_core.robot import CalibrationRecord, FitReport

FEW = "fewer than five points: none can be left out, so a mis-touched one bends the fit; touch six or more"
POOR = "too far off for grasps: touch the points with the largest residuals again, and some farther apart"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument(
        "pairs",
        type=Path,
        metavar="PAIRS",
        help="CSV file whose first line names its columns: world_x,world_y,world_z,base_x,base_y,base_z in metres, or "
        "tag,corner,base_x,base_y,base_z with the corners of the printed board, 0 to 3 clockwise from the upper left "
        "(base_x_mm and so on: millimetres, as the xArm shows them). The base point is where the tip that touches is",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="YAML", help="calibration file to write")
    parser.add_argument(
        "--tool-from",
        type=Path,
        metavar="YAML",
        help="calibration file to take the pose of the tool from (default: the file at --out, if there is one)",
    )
    parser.add_argument("--force", action="store_true", help="also write a calibration that is poor")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    add_board_arguments(parser, prefix="board-", placed=True)


def run(parsed: argparse.Namespace) -> int:
    """Fit, write, and tell how good it is."""
    from egophys_core.robot import (
        CALIBRATION_FILE,
        Calibration,
        FitQuality,
        Transform,
        fit_world_to_base,
        read_touched_pairs,
    )

    require_writable(parsed.out, CALIBRATION_FILE, inputs=[parsed.pairs])
    pairs = read_touched_pairs(parsed.pairs, lambda tag, corner: board_from(parsed).corner_in_world(tag, corner))
    fit = fit_world_to_base(pairs.world, pairs.base, names=pairs.names)
    former = parsed.tool_from or (parsed.out if parsed.out.exists() else None)
    tool = Calibration.load(former).tool if former else Transform.identity()
    record = _record(pairs.names, fit)
    written = fit.quality != FitQuality.POOR or parsed.force
    if written:
        Calibration(world_to_base=fit.world_to_base, tool=tool, record=record).save(parsed.out)
    if parsed.json:
        content = record.to_mapping() | {"quality": str(fit.quality), "expected_error_m": fit.expected_error}
        print_json(
            {"calibration": str(parsed.out) if written else None, "tool_from": former and str(former), **content}
        )
    else:
        _show(pairs.names, fit)
        kept = f"tool as in {former}" if former else "no tool: planned poses are those of the controller's TCP"
        print(f"written to {parsed.out}; {kept}" if written else "not written; --force writes it all the same")
    return 1 if fit.quality == FitQuality.POOR else 0


def _record(names: tuple[str, ...], fit: "FitReport") -> "CalibrationRecord":
    from egophys_core.robot import CalibrationRecord

    residuals = dict(zip(names, fit.residuals.tolist(), strict=True))
    used = dict(zip(names, fit.used.tolist(), strict=True))
    return CalibrationRecord(
        date_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        rms_m=fit.rms,
        leave_one_out_m=fit.leave_one_out,
        residuals_m={name: each for name, each in residuals.items() if used[name]},
        left_out_m={name: each for name, each in residuals.items() if not used[name]},
    )


def _show(names: tuple[str, ...], fit: "FitReport") -> None:
    rows = [
        (name, f"{1000 * residual:.1f}", _millimetres(other) if used else "left out: mis-touched?")
        for name, residual, other, used in zip(names, fit.residuals, fit.left_one_out, fit.used, strict=True)
    ]
    print_table("distance of each touch from the fit (mm)", ("point", "residual", "by the others"), rows)
    checked = "unknown" if fit.quality == "unchecked" else f"{1000 * fit.leave_one_out:.1f} mm"
    print(f"{fit.quality}: rms {1000 * fit.rms:.1f} mm, leave-one-out {checked} over {int(fit.used.sum())} points")
    if len(names) < 5:
        print(FEW)
    if fit.quality == "poor":
        print(POOR)


def _millimetres(metres: float) -> str:
    return f"{1000 * metres:.1f}" if metres == metres else "-"
