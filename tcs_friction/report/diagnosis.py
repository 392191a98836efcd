"""The report of a diagnosis: the sentence, where the mismatch lives, before and after, the effect isolated.

`write_report` takes the content of diagnosis.json and the `Evidence`, the arrays behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tcs_friction.diagnose.outcome.plot_data import Evidence
from tcs_friction.report.diagnosis_plots import (
    SIGNIFICANT,
    draw_atlas,
    draw_friction,
    draw_isolated,
    draw_map,
    draw_message,
    draw_series,
    percent,
    plain,
    stated,
    telling,
)
from tcs_friction.report.html import (
    Cell,
    Html,
    Number,
    key_numbers,
    page,
    picture,
    section,
    table,
    write_page,
)
from tcs_friction.report.numbers import interval, unbroken, with_error

WORDS = {
    "match": "the model matches",
    "parameters": "wrong parameters, no missing physics",
    "missing_physics": "physics is missing",
    "unexplained": "something outside the vocabulary remains",
}


def write_report(
    directory: Path,
    diagnosis: Mapping[str, Any],
    evidence: Evidence,
    axis: str = "axis",
    next_experiment: str | None = None,
) -> Path:
    """Write DIR/report.html and its pictures; returns the path. `next_experiment` is shown as it is."""
    message, where, series = draw_message(diagnosis, evidence), draw_atlas(evidence), draw_series(evidence, diagnosis["fit"])
    friction = draw_friction(evidence)
    effects = [draw_isolated(item, i, evidence) for i, item in enumerate(evidence.isolated)]
    parts = [
        picture(message),
        key_numbers(_numbers(diagnosis, evidence)),
        section("Where the mismatch lives", picture(where), _atlas_table(diagnosis)),
        section("Before and after", picture(series), _fit_table(diagnosis, evidence)),
        section("Parameters", _parameters_table(diagnosis["parameters"])),
        *([section("Friction against speed", picture(friction))] if friction else []),
    ]
    if diagnosis["effects"]:
        parts.append(section("What was left out", _effects_table(diagnosis["effects"], evidence), *map(picture, effects)))
    if diagnosis["described"]:
        parts.append(
            section(
                "What predicts, but is not established",
                "These predict torque, and a rule refused their names: they may be parts of what is not in the vocabulary.",
                _effects_table(diagnosis["described"], evidence),
                _refusals_table(diagnosis["described"]),
                *map(picture, effects if not diagnosis["effects"] else ()),
            )
        )
    if evidence.learned is not None:
        remains = draw_map(evidence.learned, evidence.torque_unit)
        effects.append(remains)
        parts.append(section("What nothing in the vocabulary explains", picture(remains)))
    if diagnosis["refused"]:
        rows = [[one["effect"], one["question"], one["words"]] for one in diagnosis["refused"]]
        parts.append(section("What no rule let in", table(["effect", "no was the answer to", "numbers"], rows)))
    if evidence.runners_up:
        rows = [[r.effect, f"{r.score:.3g}", r.reason] for r in evidence.runners_up]
        head = ["hypothesis", "gain (chi-squared)", "why it lost"]
        parts.append(section("What else was considered", table(head, rows)))
    parts.append(section("What to record next", next_experiment or "Nothing: this recording is enough."))
    if evidence.notes:
        parts.append(section("Notes", *evidence.notes))
    remark = f"Verdict: {WORDS[diagnosis['verdict']]}."
    document = page(f"Diagnosis of {axis}", diagnosis["headline"], diagnosis["statement"], *parts, remark=remark)
    pictures = [message, where, series, *([friction] if friction else []), *effects]
    return write_page(directory / "report.html", document, pictures)


def _numbers(diagnosis: Mapping[str, Any], evidence: Evidence) -> list[Number]:
    fit, unit = diagnosis["fit"], evidence.torque_unit
    names = dict.fromkeys(e["effect"].replace("_", " ") for e in diagnosis["effects"])
    found = ", ".join(names) or ("something without a name" if diagnosis["verdict"] == "unexplained" else "nothing")
    improved, floor = stated(fit["improved"]), fit["noise_floor"]
    kept = "held-out" if fit["improved"]["untouched"] is None else "untouched"
    over = f"{improved / floor:.2f} times the noise floor" if floor else "noise floor unknown"
    return [
        Number("physics left out", found),
        Number(f"{kept} residual, as believed", f"{stated(fit['believed']):.3g} {unit}"),
        Number("same physics, best parameters", f"{stated(fit['retuned']):.3g} {unit}"),
        Number(
            "with the physics found",
            f"{improved:.3g} {unit}",
            over,
            bool(floor and improved <= 1.1 * floor) or None,
        ),
    ]


def _atlas_table(diagnosis: Mapping[str, Any]) -> Html:
    rows: list[list[str | Cell]] = []
    for entry in sorted(diagnosis["atlas"], key=lambda e: -telling(e["coordinate"], e["share"])):
        here = entry["p_value"] < SIGNIFICANT
        p_value = "< 0.001" if entry["p_value"] < 0.001 else f"{entry['p_value']:.3f}"
        rows.append([plain(entry["coordinate"]), percent(entry["share"]), p_value, _where(entry) if here else ""])
    return table(["coordinate", "share of residual power", "p-value", "where"], rows)


def _where(entry: Mapping[str, Any]) -> str:
    """The range or the period of an entry of the atlas."""
    unit, period, limits = entry["unit"], entry["period"], entry["range"]
    if period and entry["coordinate"] == "frequency":
        return f"{1.0 / period:.4g} {unit}"
    if period:
        return f"every {period:.4g} {unit}"
    return interval(limits[0], limits[1], unit) if limits else "everywhere"


def _fit_table(diagnosis: Mapping[str, Any], evidence: Evidence) -> Html:
    models = (
        ("believed", "as given"),
        ("retuned", "same physics, best parameters"),
        ("improved", "with the physics found"),
        *([("written", "with what is named alone, as in axis.yaml")] if diagnosis["described"] else []),
    )
    free = diagnosis.get("free_run") or {}
    position = free.get("position_rms") or {}
    loop = (diagnosis.get("closed_loop") or {}).get("position_rms") or {}
    rows = [
        [
            f"{name}: {words}",
            *(_digits(diagnosis["fit"][name][part]) for part in ("train", "held_out", "untouched")),
            _percent(diagnosis["fit"][name]["fit_percent"]),
            _digits(position.get(name)),
            *([_digits(loop[name])] if loop else []),
        ]
        for name, words in models
    ]
    unit = unbroken(evidence.torque_unit)
    horizon = free.get("horizon")
    after = f", rms over {horizon:.3g} s" if horizon else ""
    head = [
        "model",
        f"residual, train ({unit})",
        f"residual, held out ({unit})",
        f"residual, untouched ({unit})",
        "fit of it (1 - NRMSE)",
        f"free-run error{after} ({evidence.position_unit})",
        *([f"closed-loop error{after} ({evidence.position_unit})"] if loop else []),
    ]
    return table(head, rows, f"Noise floor {_digits(diagnosis['fit']['noise_floor'])} {unit}")


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f} %"


def _digits(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _parameters_table(told: Sequence[Mapping[str, Any]]) -> Html:
    def cell(one: Mapping[str, Any] | None) -> str:
        return "–" if one is None else unbroken(with_error(one["value"], one["std"]))

    rows = [
        [f"{one['name']} ({one['unit']})", _digits(one["believed"]), cell(one["retuned"]), cell(one["improved"])] for one in told
    ]
    return table(["parameter", "believed", "retuned", "with the physics found"], rows)


def _refusals_table(described: Sequence[Mapping[str, Any]]) -> Html:
    rows = [[entry["effect"], one["question"], one["words"]] for entry in described for one in entry["refused"]]
    return table(["effect", "no was the answer to", "numbers"], rows)


def _effects_table(found: Sequence[Mapping[str, Any]], evidence: Evidence) -> Html:
    rows: list[Sequence[str | Cell]] = []
    for entry in found:
        values = "; ".join(
            unbroken(f"{name} {with_error(p['value'], p.get('std'))} {p.get('unit') or ''}".rstrip())
            for name, p in entry["parameters"].items()
        )
        rows.append(
            [
                entry["effect"],
                values,
                entry["subsystem"],
                f"{entry['torque_rms']:.3g}",
                f"{100.0 * entry['probability']:.0f} %",
                ", ".join(entry["equivalent"]) or "nothing else",
            ]
        )
    head = [
        "effect",
        "parameters",
        "look at",
        unbroken(f"rms, {evidence.torque_unit}"),
        "probability",
        "cannot be told from",
    ]
    return table(head, rows)
