"""The room starts without torch, and says what to install."""

import subprocess
import sys

import pytest

from egophys_core.perception.learned import GroundedSam2, LearnedModelError
from egophys_core.perception.learned.weights import require_module


@pytest.mark.parametrize("name", ["egophys_core.perception", "egophys_core.perception.learned"])
def test_importing_loads_none_of_the_models_packages(name):
    program = f"import sys, {name}; print(' '.join({{each.split('.')[0] for each in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert not {"torch", "transformers", "cotracker", "vggt", "trellis"} & set(done.stdout.split())


def test_a_missing_package_is_told_with_the_command_that_installs_it():
    with pytest.raises(LearnedModelError, match=r"cannot import no_such_package .* install it: pip install x"):
        require_module("no_such_package", "pip install x")


def test_without_transformers_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(LearnedModelError, match=r"pip install -e '.\[learned\]'"):
        GroundedSam2(tmp_path, tmp_path, object_prompt="a towel")
