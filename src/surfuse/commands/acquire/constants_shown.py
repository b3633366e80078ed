"""What a study of the paper's constants found, as data, as lines of a terminal, and as a table of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from surfuse.commands.acquire.paper_constants import SHOWN, Constant, ConstantsStudy, Trial
from surfuse.report.content import PageTable

_NAMES = ("eighth", "halved", "doubled", "eightfold")


def constants_data(study: ConstantsStudy, scenes: Sequence[str]) -> dict[str, object]:
    """As plain data: the settings, and the dense error in mm on each scene."""
    return {
        "configured": _trial_data(study.configured, scenes),
        "best_common": _trial_data(study.best, scenes),
        "sensitivity": {
            one.constant.name: {
                "value": one.constant.value,
                **{name: _errors(trial, scenes) for name, trial in zip(_NAMES, one.trials, strict=True)},
            }
            for one in study.sensitivity
        },
    }


def constants_rows(study: ConstantsStudy, scenes: Sequence[str]) -> list[tuple[str, str]]:
    """As lines of a table: each constant changed alone, then the best common setting."""
    rows = [("constants of the paper", f"dense mm on {', '.join(scenes)}: as configured, {', '.join(_NAMES)}")]
    rows += [
        (
            f"{one.constant.name} = {one.constant.value:g}",
            "   ".join(_in_words(trial) for trial in (study.configured, *one.trials)),
        )
        for one in study.sensitivity
    ]
    return [*rows, ("best common setting", f"{_in_words(study.best)} with {_setting(study.changed)}")]


def constants_table(study: ConstantsStudy, scenes: Sequence[str]) -> PageTable:
    """As a table of the report: a row a constant, for each scene the errors with multiples of its value."""
    rows = [("as configured", "", *(f"{error:.2f}" for error in study.configured.dense_rmse_mm))]
    for one in study.sensitivity:
        for name, factor, trial in zip(_NAMES, SHOWN, one.trials, strict=True):
            value = f"{factor * one.constant.value:g} ({name})"
            rows.append((one.constant.name, value, *_cells(trial, len(scenes))))
    rows.append(("best common setting", _setting(study.changed), *_cells(study.best, len(scenes))))
    return PageTable(
        "Constants of the paper's method",
        ("constant", "value", *(f"{scene}, dense RMSE (mm)" for scene in scenes)),
        tuple(rows),
        "The paper gives no constants. Here each is changed alone, on the same readings; the last row is "
        "one setting for all scenes, searched by their geometric mean error. It knows the truth; a user does not.",
    )


def _in_words(trial: Trial | None) -> str:
    return "not allowed" if trial is None else " ".join(f"{error:.2f}" for error in trial.dense_rmse_mm)


def _cells(trial: Trial | None, count: int) -> tuple[str, ...]:
    return ("not allowed",) * count if trial is None else tuple(f"{error:.2f}" for error in trial.dense_rmse_mm)


def _setting(changed: Sequence[Constant]) -> str:
    return ", ".join(f"{one.name} = {one.value:g}" for one in changed) or "no constant changed"


def _errors(trial: Trial | None, scenes: Sequence[str]) -> dict[str, float | None] | None:
    if trial is None:
        return None
    found = zip(scenes, trial.dense_rmse_mm, strict=True)
    return {scene: error if math.isfinite(error) else None for scene, error in found}


def _trial_data(trial: Trial, scenes: Sequence[str]) -> dict[str, object]:
    setting = {one.name: one.value for one in trial.constants}
    return {"setting": setting, "dense_rmse_mm": _errors(trial, scenes)}
