"""`egophys import VIDEO --out BAG`: films, folders of pictures and recordings of Aria glasses."""

import argparse
from dataclasses import asdict
from pathlib import Path

from egophys_core.cli.display import print_json, progress_bar
from egophys_core.errors import OptionsError
from egophys_core.files import require_apart

CAMERA_LABEL = "camera-rgb"
"""That of `import_vrs`, which is not loaded for `--help`."""
QUARTER_TURNS = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument(
        "video", type=Path, metavar="VIDEO", help="film (.mp4, .mov ...), folder of pictures, or .vrs of Aria glasses"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="rosbag2 folder to write")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a line")
    add_source_arguments(parser)
    vrs = parser.add_argument_group("Aria glasses", "for .vrs, which hold their own calibration")
    vrs.add_argument("--camera", help=f"label of the camera (default {CAMERA_LABEL})")
    vrs.add_argument("--size", type=int, help="width and height of the images (default: as recorded)")
    vrs.add_argument("--focal-length", type=float, help="of the images, pixels (default: keeps the resolution)")
    vrs.add_argument(
        "--quarter-turns",
        type=int,
        choices=range(4),
        help=f"to the right until upright (default {QUARTER_TURNS}, as Aria Gen 1 needs)",
    )


def add_source_arguments(parser: argparse.ArgumentParser, *, intrinsics: bool = True) -> None:
    """Arguments of films and folders of pictures.

    Args:
        parser: to add them to.
        intrinsics: also ask for the camera's.
    """
    group = parser.add_argument_group("films and pictures")
    if intrinsics:
        group.add_argument(
            "--intrinsics",
            type=Path,
            metavar="YAML",
            help="calibration of the camera, as `egophys calibrate-camera` or ROS's camera_calibration writes it",
        )
    group.add_argument("--rate", type=float, metavar="HZ", help="of the pictures in a folder")
    group.add_argument("--times", type=Path, metavar="FILE", help="time of each picture in a folder, seconds, by line")


def source_paths(parsed: argparse.Namespace) -> list[Path]:
    """The video, and the files given with `add_source_arguments`."""
    given = (parsed.video, parsed.times, getattr(parsed, "intrinsics", None))
    return [each for each in given if each is not None]


def run(parsed: argparse.Namespace) -> int:
    """Import."""
    require_apart(parsed.out, source_paths(parsed))
    is_vrs = parsed.video.suffix.lower() == ".vrs"
    of_vrs, of_others = ("camera", "size", "focal_length", "quarter_turns"), ("intrinsics", "rate", "times")
    for name in of_others if is_vrs else of_vrs:
        if getattr(parsed, name) is not None:
            kind = "films and pictures" if is_vrs else ".vrs recordings"
            raise OptionsError(f"--{name.replace('_', '-')} is for {kind}, {parsed.video} is none")
    return _import_vrs(parsed) if is_vrs else _import_frames(parsed)


def _import_frames(parsed: argparse.Namespace) -> int:
    from egophys_core.perception.camera.frame_source import open_frames
    from egophys_core.perception.camera.intrinsics_file import camera_of, read_intrinsics
    from egophys_core.perception.camera.video_import import import_frames

    if parsed.intrinsics is None:
        raise OptionsError(
            "a film does not tell its camera: give --intrinsics cam.yaml; `egophys calibrate-camera` makes one from a "
            "film of the printed board"
        )
    intrinsics = read_intrinsics(parsed.intrinsics)
    source = open_frames(parsed.video, rate_hz=parsed.rate, times=parsed.times)
    if source.camera is not None:
        raise OptionsError(f"{parsed.video} is a bag with its own calibration; `egophys perceive` reads it as it is")
    camera, notes = camera_of(source, intrinsics)
    with progress_bar() as report:
        written = import_frames(source, camera, parsed.out, progress=lambda share: report("import", share))
    content = {"bag": str(parsed.out), **asdict(written), "width": source.width, "height": source.height}
    if parsed.json:
        print_json({**content, "rotation_deg": source.rotation_deg, "notes": list(notes)})
        return 0
    for note in notes:
        print(f"note: {note}")
    print(f"{written.frames} images of {source.width} x {source.height}, {written.seconds:.1f} s, in {parsed.out}")
    return 0


def _import_vrs(parsed: argparse.Namespace) -> int:
    from egophys_core.recording.vrs import import_vrs

    with progress_bar() as report:
        video = import_vrs(
            parsed.video,
            parsed.out,
            camera=parsed.camera or CAMERA_LABEL,
            size=parsed.size,
            focal_length=parsed.focal_length,
            quarter_turns=QUARTER_TURNS if parsed.quarter_turns is None else parsed.quarter_turns,
            progress=lambda share: report("import", share),
        )
    if parsed.json:
        print_json({"bag": str(parsed.out), **asdict(video)})
    else:
        left_out = f", {video.left_out} not decodable left out" if video.left_out else ""
        print(f"{video.frames} images of {video.size} x {video.size}, {video.seconds:.1f} s{left_out}, in {parsed.out}")
    return 0
