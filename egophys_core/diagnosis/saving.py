"""What a diagnosis leaves on disk: the numbers, the improved twin and the report, in one folder."""

from pathlib import Path

from egophys_core.diagnosis.diagnose import Finding
from egophys_core.diagnosis.diagnosis import save_diagnosis
from egophys_core.effects import LIBRARY
from egophys_core.files import new_folder, write_atomically
from egophys_core.reporting import EffectText, diagnosis_html
from egophys_core.twin import encode_twin

DIAGNOSIS_NAME, TWIN_NAME, REPORT_NAME = "diagnosis.json", "improved.twin", "report.html"


def effect_texts() -> dict[str, EffectText]:
    """What a reader needs to know of the effects, by name; of those that are added from outside now, too."""
    return {
        name: EffectText(
            summary=effect.summary,
            equation=effect.equation,
            nulls={each.name: each.null for each in effect.parameters if each.null is not None},
        )
        for name, effect in LIBRARY.items()
    }


def save_finding(finding: Finding, folder: Path) -> dict[str, Path]:
    """Write `diagnosis.json`, `improved.twin` and `report.html` into a new or empty folder, all or none.

    Returns:
        The files written, under the keys diagnosis, twin and report.

    Raises:
        OutputError: `folder` is a file or not empty, or cannot be made.
    """
    with new_folder(folder) as part:
        save_diagnosis(finding.diagnosis, part / DIAGNOSIS_NAME)
        write_atomically(part / TWIN_NAME, encode_twin(finding.twin))
        write_atomically(part / REPORT_NAME, report(finding).encode())
    return {"diagnosis": folder / DIAGNOSIS_NAME, "twin": folder / TWIN_NAME, "report": folder / REPORT_NAME}


def report(finding: Finding) -> str:
    """The finding as HTML."""
    evidence = finding.evidence
    return diagnosis_html(
        finding.diagnosis.as_dict(),
        times=evidence.times,
        before=evidence.before,
        after=evidence.after,
        rest=evidence.rest,
        field=evidence.field,
        texts=effect_texts(),
        mismatch_gain=evidence.mismatch_gain,
    )
