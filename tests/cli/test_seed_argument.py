"""Seeds on the command line: what no generator takes is refused as arguments are parsed."""

import pytest

from egophys_core.cli.main import make_parser

REQUIRED = {
    "build": ("lift", "--out", "t.twin"),
    "plan": ("t.twin", "--target", "present", "--out", "p.json"),
    "diagnose": ("t.twin", "lift", "--out", "d"),
    "rehearse": ("--out", "lab"),
}


@pytest.mark.parametrize(
    ("command", "option"), [*((command, "--seed") for command in REQUIRED), ("rehearse", "--object-seed")]
)
def test_a_seed_is_a_whole_number_from_zero_on(capsys, command, option):
    def parse(value):
        return make_parser(command).parse_args([command, *REQUIRED[command], option, value])

    assert vars(parse("7"))[option.strip("-").replace("-", "_")] == 7
    for value in ("-1", "1.5", "x"):
        with pytest.raises(SystemExit) as stopped:
            parse(value)
        assert stopped.value.code == 2
        assert f"argument {option}: must be a whole number from 0 on, got '{value}'" in capsys.readouterr().err
