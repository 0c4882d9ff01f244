"""`stoop demo`, `validate` and `agreement`: the job without a file, predictions, flight against flight."""

from __future__ import annotations

import argparse
from contextlib import suppress
from typing import Literal

from stoop.base.files import check_targets, recorded_inputs
from stoop.cli import options
from stoop.cli.page import fixed, numbers, page, words
from stoop.cli.progress import LiveLine
from stoop.errors import StoopError


def demo(arguments: argparse.Namespace) -> int:
    """Simulate, identify from wrong values, print truth beside estimate, write the report."""
    from stoop.results.result import read_result
    from stoop.workflow.demo import NAME, identify_demo
    from stoop.workflow.outputs import RESULT, check_folder
    from stoop.workflow.summary import estimates_table

    overwrite = arguments.overwrite
    with suppress(StoopError), recorded_inputs():  # the result of an earlier demo nobody will miss
        overwrite |= {m.flight for m in read_result(arguments.output / RESULT).maneuvers} == {NAME}
    check_folder(arguments.output, [NAME], overwrite)
    job, truth = identify_demo(arguments.seed)
    out, result = page(), job.result
    aircraft = "The paper's twin-boom aircraft (mass and area reconstructed)"
    out.line(f"{aircraft} flies a 3-2-1-1; its sensors are noisy.")
    out.line("Ten coefficients are identified, starting from values up to 60 % wrong:")
    out.line()
    out.text(estimates_table(result.parameters, truth))
    out.line()
    spent = f"{result.trajectories:.0f} trajectories, {result.seconds:.2f} s"
    out.line(f"{result.status} ({spent}); writing the report ...")
    folder = job.save(arguments.output, overwrite)
    out.line(f"report: {folder / 'report.html'}")
    return 0


def validate(arguments: argparse.Namespace) -> int:
    """Predict, write, and print how well."""
    from stoop.flight.load import load_several
    from stoop.report.maneuvers import prediction_verdict
    from stoop.results.text import window_line
    from stoop.workflow.summary import figures_table
    from stoop.workflow.validation import NAMES
    from stoop.workflow.validation import validate as validated

    check_targets(arguments.output, NAMES, arguments.overwrite)
    with LiveLine("reading and predicting"):
        flights = load_several(arguments.flight, arguments.mapping)
        start: Literal["measured"] | None = "measured" if arguments.open_loop else None
        windows, command = arguments.maneuver, options.command_line()
        done = validated(arguments.result, flights, windows, command, start)
    done.save(arguments.output, arguments.overwrite)
    out, record, verdict = page(), done.record, done.model.result.verdict
    refused = verdict.grade == "do not use"
    out.line(prediction_verdict(record.maneuvers, refused).headline)
    out.bullets(map(window_line, record.maneuvers))
    if record.compared and len(record.maneuvers) > 1:
        out.line(f"better than a first-order lag in {record.better} of {record.compared} channels")
    if record.open_loop:
        out.heading("open loop from the measured start: rms error over the range, mean of the channels")
        names = list(dict.fromkeys(name for own in record.open_loop.values() for name in own))
        spans = record.open_loop.values()
        scores = [numbers(name, [own.get(name, float("nan")) for own in spans]) for name in names]
        out.table(words("window", record.open_loop), *scores)
    out.bullets(record.warnings, "warnings")
    if arguments.verbose:
        out.heading("figures")
        out.text(figures_table(record.maneuvers))
        out.bullets(record.notes, "found while preparing the data")
    out.line()
    out.line(f"page: {arguments.output / NAMES[0]}")
    return 0


def agreement(arguments: argparse.Namespace) -> int:
    """Print whether results agree within their error bars, parameter by parameter and over all."""
    from stoop.assessment.uncertainty import agreement as compared
    from stoop.workflow.load import load
    from stoop.workflow.summary import refusal

    if len(set(arguments.result)) < 2:
        arguments.complain("two results or more are compared; name each once")
    results = {str(path): load(path).result for path in arguments.result}
    found, out = compared(results), page()
    told = {name: one for name, one in found.parameters.items() if one.verdict}
    of_first = results[str(arguments.result[0])].parameters
    columns = [words("parameter", told), words("unit", (of_first[n].unit for n in told))]
    for i, path in enumerate(arguments.result, 1):
        own = [one.singles[i - 1] for one in told.values()]
        out.line(f"{i}: {path}")
        known = [(one.estimate, one.std_error) if one.counted else (float("nan"),) * 2 for one in own]
        columns.append(numbers(f"{i}, without prior", [estimate for estimate, _ in known]))
        columns.append(numbers("std error", [error for _, error in known]))
    columns.append(fixed("chi-square", [one.chi_square for one in told.values()], 2))
    columns.append(fixed("degrees", [one.degrees for one in told.values()], 0))
    out.table(*columns, words("", [one.verdict for one in told.values()]))
    out.line()
    if told:
        agreeing = sum(one.verdict == "agree" for one in told.values())
        out.line(
            f"{agreeing} of {len(told)} parameters ({100 * found.share_agreeing:.0f} %) agree within 95 %; the scatter is "
            f"{found.scatter_ratio:.2f} times that of the error bars"
        )
        if found.joint.degrees:
            out.line(str(found.joint))
    else:
        out.line("no parameter is determined by two of the results without its prior")
    refused = [told for path, one in results.items() for told in refusal(one, path)]
    out.bullets([*refused, *found.remarks], "notes")
    return 0
