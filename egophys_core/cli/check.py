"""`egophys check VIDEO`."""

import argparse
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.board_arguments import add_board_arguments, board_from
from egophys_core.cli.display import print_json, print_remarks, progress_bar
from egophys_core.cli.import_ import add_source_arguments, source_paths
from egophys_core.cli.object_argument import add_object_argument, with_object
from egophys_core.cli.perceive import add_topic_arguments
from egophys_core.files import FileKind, require_writable, write_atomically
from egophys_core.perception.options import PerceptionOptions

if TYPE_CHECKING:
    from egophys_core.perception.check.check_video import Checked
    from egophys_core.perception.check.watching import Watched

JPEG, PNG = (
    FileKind(name=f"a {name} picture", head=head) for name, head in (("JPEG", rb"\xff\xd8"), ("PNG", rb"\x89PNG"))
)
PICTURES = {".jpg": JPEG, ".jpeg": JPEG, ".png": PNG}
"""By extension."""
SHARES = {"tags": (0.0, 0.5), "hands": (0.5, 1.0)}
"""Where the stages begin and end on the bar."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("video", type=Path, metavar="VIDEO", help="film, folder of pictures, or bag")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="PICTURE",
        help="picture to write, .jpg or .png; its upper left part is the view in "
        "which the object is chosen, pixel by pixel",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    add_object_argument(parser)
    add_source_arguments(parser)
    add_topic_arguments(parser)
    add_board_arguments(parser, prefix="board-", placed=True)


def run(parsed: argparse.Namespace) -> int:
    """Check."""
    from threadpoolctl import threadpool_limits

    from egophys_core.errors import OptionsError
    from egophys_core.perception.camera.frame_source import open_frames
    from egophys_core.perception.camera.intrinsics_file import camera_of, read_intrinsics
    from egophys_core.perception.check.check_video import check
    from egophys_core.perception.check.watching import watch
    from egophys_core.perception.remarks import verdict_of

    began = time.perf_counter()
    options = with_object(PerceptionOptions(), parsed.object)
    if parsed.out is not None:
        kind = PICTURES.get(parsed.out.suffix.lower())
        if kind is None:
            raise OptionsError(f"--out must end in .jpg or .png, got {parsed.out}")
        require_writable(parsed.out, kind, inputs=source_paths(parsed))
    notes: list[str] = []
    # The matrices are small: threads of the linear algebra wait for each other longer than they work.
    with progress_bar() as report, threadpool_limits(1), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        source = open_frames(
            parsed.video,
            rate_hz=parsed.rate,
            times=parsed.times,
            image_topic=parsed.image_topic,
            info_topic=parsed.info_topic,
        )
        camera = source.camera
        if parsed.intrinsics is not None:
            camera, said = camera_of(source, read_intrinsics(parsed.intrinsics))
            notes += said

        def tell(stage: str, share: float) -> None:
            begin, end = SHARES[stage]
            report(stage, begin + (end - begin) * share)

        watched = watch(source, camera, board_from(parsed), options, tell)
    warned = tuple(dict.fromkeys(str(each.message) for each in caught if issubclass(each.category, UserWarning)))
    checked = check(watched, options.still_s, warned)
    verdict = verdict_of(checked.remarks)
    if parsed.out is not None:
        _write_picture(parsed.out, watched, checked, options)
    if parsed.json:
        print_json(
            {
                "video": str(parsed.video),
                "picture": str(parsed.out) if parsed.out else None,
                "verdict": verdict,
                "remarks": [vars(each) for each in checked.remarks],
                "notes": notes,
                "elapsed_s": time.perf_counter() - began,
            }
        )
    else:
        print_remarks(parsed.video.resolve().name, checked.remarks)
        for note in notes:
            print(f"note: {note}")
        print(verdict + (f"; look at {parsed.out}" if parsed.out else ""))
    return 1 if verdict == "poor" else 0


def _write_picture(out: Path, watched: "Watched", checked: "Checked", options: PerceptionOptions) -> None:
    import cv2

    from egophys_core.perception.check.check_picture import check_picture

    point = options.object_point if any(options.object_point) else None
    picture = check_picture(watched, checked, point=point)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 92] if out.suffix.lower() != ".png" else []
    write_atomically(out, bytes(cv2.imencode(out.suffix.lower(), picture, quality)[1]))
