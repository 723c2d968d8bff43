"""A recorded video in which the tag board is not one: poses from the table, up to scale, and said so."""

from pathlib import Path

import numpy as np
import pytest

from egophys_core.perception.camera.board import Board
from egophys_core.perception.options import PerceptionOptions
from egophys_core.perception.perceive import perceive

VIDEO = Path(__file__).resolve().parents[3] / "examples/towel_lift_video.mcap"


@pytest.mark.slow
def test_without_a_board_the_episode_is_up_to_scale_and_says_so():
    # Tags from 100 on are nowhere: the sheet that lies there is a thing on the table like others.
    options = PerceptionOptions(camera_height_m=0.573)
    perceived = perceive(VIDEO, board=Board(first_id=100), options=options)
    assert not perceived.report.scale_is_known
    assert "scale assumed" in perceived.episode.name
    assert any("no tag board" in note for note in perceived.report.notes)
    # With the true height of the camera the towel has its true size: 0.288 x 0.214 m. Points that are spread evenly
    # weigh its rim more than its area does, which makes it 3 % larger.
    start = perceived.episode.points[0][perceived.episode.visible[0]]
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(start[:, :2].T)))
    np.testing.assert_allclose(spread * np.sqrt(12), [0.214, 0.288], rtol=0.08)
