"""`stoop vehicle new`: drafts a vehicle file; on a terminal it asks for what is missing."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.extend.files import write_file
from stoop.extend.text import printable
from stoop.extend.verbs import LiveLine, options, page

if TYPE_CHECKING:
    from stoop_draft.vehicle_draft.request import Evidence, Question, Request

NUMBERS = ("mass", "span", "chord", "area")


def run(arguments: argparse.Namespace) -> int:
    """Draft, print what speaks against it and what comes next."""
    from stoop.extend.flights import load_several
    from stoop_draft.vehicle_draft.draft import draft
    from stoop_draft.vehicle_draft.geometry import Geometry
    from stoop_draft.vehicle_draft.request import Request, evidence, with_geometry

    output: Path = arguments.output
    geometry = None if arguments.geometry is None else Geometry.load(arguments.geometry)
    given = {key: getattr(arguments, key) for key in ("template", *NUMBERS, "engine", "name", "aerodynamics")}
    request = with_geometry(Request(geometry=geometry, **given))
    with LiveLine("reading the log"):
        flights = load_several(arguments.flight, arguments.mapping)
    if sys.stdin.isatty() and sys.stdout.isatty():
        request = asked(request, evidence(flights), lambda question: input(printable(question)), page().text)
    with LiveLine("drafting"):
        drafted = draft(request, flights, str(output))
    write_file(output, drafted.text)
    out = page()
    free = len(drafted.vehicle.free_parameters)  # as reports count: without biases of sensors
    out.line(f"{output}: {len(drafted.text.splitlines())} lines, {free} free parameters; read its comments")
    out.bullets(drafted.notices, "What speaks against it")
    out.line()
    if flights:
        source = options.source_arguments(arguments.flight, arguments.mapping)
        windows = f"{output.stem}-windows"
        out.command("next: ", ["stoop", "maneuvers", *source, "--vehicle", str(output), "-o", windows])
    else:
        out.command("next: ", ["stoop", "trim", str(output)])
    return 0


def asked(
    request: Request, known: Evidence, ask: Callable[[str], str], tell: Callable[[str], Any]
) -> Request:
    """Ask for what is missing until nothing is.

    Parameters
    ----------
    request : Request
    known : Evidence
        Of the logs.
    ask : callable
        Shows a question and returns the answer, as `input`.
    tell : callable
        Shows a line, as `print`.
    """
    from stoop_draft.vehicle_draft.request import TEMPLATES, Question, questions

    usual = known.template()
    if request.template is None:
        question = Question("template", f"kind of vehicle ({', '.join(TEMPLATES)})", "", usual)
        request = replace(request, template=_answer(question, ask, tell))
    while lacking := questions(request, known):
        request = replace(request, **{lacking[0].key: _answer(lacking[0], ask, tell)})
    if request.engine is None:
        engine = Question("engine", "electric, piston, jet or none", "", known.engine(str(request.template)))
        request = replace(request, engine=_answer(engine, ask, tell))
    return request


def _answer(question: Question, ask: Callable[[str], str], tell: Callable[[str], Any]) -> Any:
    from stoop_draft.vehicle_draft.power import ENGINES
    from stoop_draft.vehicle_draft.request import TEMPLATES

    choices = {"template": TEMPLATES, "engine": ENGINES}.get(question.key)
    usual = f" (usual: {question.usual})" if question.usual else ""
    default = f" [{question.default}]" if question.default is not None else ""
    while True:
        try:
            text = ask(f"{question.key}, {question.what}{usual}{default}: ").strip()
        except EOFError:  # Ctrl-D
            raise KeyboardInterrupt from None
        if not text and question.default is not None:
            return question.default
        if choices is not None:
            if text in choices:
                return text
            tell(f"choose one of {', '.join(choices)}")
            continue
        try:
            return options.positive(text)
        except argparse.ArgumentTypeError as error:
            tell(f"{error}; write it in SI units")
