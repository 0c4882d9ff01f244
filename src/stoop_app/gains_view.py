"""The gains of an autopilot: those that flew judged around a fitted model, and better ones by damping and noise."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import panel as pn

from stoop.extend.verbs import verbs
from stoop_app import parts
from stoop_app.fit_view import finished
from stoop_app.folder import modified
from stoop_app.places import reading
from stoop_app.steps import COMMAND, OUTPUT, PRODUCTS, Step
from stoop_app.uploads import safe_name
from stoop_app.view import View
from stoop_tune.control_laws.parameters import ENDINGS
from stoop_tune.gain_search import DAMPING, Specification

TUNE: Final = verbs()["tune"]
MARGINS: Final = tuple(map(TUNE.option, ("gain_margin", "phase_margin", "disk_margin", "noise")))
ANYWAY: Final = TUNE.option("anyway").name
FILES: Final = ", ".join(sorted(ENDINGS))
NO_PARAMETERS: Final = (
    "The log holds no parameters of an autopilot whose law is known. Send a file of those that it flew with, as a ground "
    f"station saves it ({FILES})."
)
BETTER: Final = (
    "Better gains: those that reject gusts best while 95 % of the models keep these margins (gain, phase, disk) and the gyro's "
    "noise moves commands by no more than this. Files lead to them in four trial flights."
)
SEARCHING: Final = "searching gains; this takes a minute or more"


class GainsView(View):
    """Judge gains, propose better ones."""

    title = "Gains"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._model = pn.widgets.Select(label="model", width=130, margin=(0, 12, 4, 0))
        self._gains = pn.widgets.Select(label="gains that flew", width=240, margin=(0, 12, 4, 0))
        presets = {f"{n}, {s.gain:g} dB, {s.phase:g} deg, {s.disk:g} dB": s for n, s in DAMPING.items()}
        self._damping = pn.widgets.DiscreteSlider(
            label="damping", options=presets, value=Specification(), width=340
        )
        self._noise = pn.widgets.FloatSlider(
            label="noise, % of a full command",
            start=0.5,
            end=20.0,
            step=0.5,
            value=Specification().noise,
            width=240,
        )
        self._judge = parts.button(
            "Judge their margins", self.act(partial(self._start, False)), "primary", align="end"
        )
        self._propose = parts.button("Propose gains", self.act(partial(self._start, True)), "primary")
        self._stage = pn.Column(**parts.FILLING)
        for pick in (self._model, self._gains):
            pick.param.watch(lambda e: self.act(self._turn)(), "value")

    def refresh(self) -> None:
        """Offer models and parameters, and show what is known of their gains."""
        runs, gains = {name: name for name in reversed(finished(self.project))}, self._sources()
        if not runs:
            self.body[:] = [parts.html(parts.soft("A fit that is done is needed first."))]
            return
        for pick, options in ((self._model, runs), (self._gains, gains)):
            kept = pick.value if pick.value in options.values() else next(iter(options.values()), None)
            pick.param.update(options=options, value=kept)
        sent = pn.widgets.FileInput(accept=FILES, multiple=False, margin=(4, 0))
        sent.param.watch(lambda e: self.act(lambda: self._take(sent.filename, e.new))(), "value")
        file, lacking = parts.card("Gains of a file", sent), "" if gains else NO_PARAMETERS
        self._judge.disabled, file.collapsed = not gains, bool(gains)
        picks = pn.FlexBox(self._model, self._gains, self._judge, align_items="flex-end")
        self.body[:] = [picks, parts.html(parts.soft(lacking)), file, self._stage]
        self._turn()

    def _sources(self) -> dict[str, str]:
        """Return where the gains that flew can be taken from, by what it is called: the log first, then files."""
        own = (p for p in self.project.root.iterdir() if p.suffix.lower() in ENDINGS)
        files = {p.name: f"./{p.name}" for p in sorted(own) if p.is_file() and not p.is_symlink()}
        flight = self.project.flight
        if flight is None:
            return files
        with reading(flight.file(OUTPUT)):
            laws = " and ".join(self.project.info.get("control_laws", ()))
        log = self.project.source[0]
        return {f"{Path(log).name}, {laws}": log, **files} if laws else files

    def _take(self, name: str, content: bytes) -> None:
        """Keep a file of parameters that the browser sent, and choose it."""
        self.project.take_parameters(safe_name(name), content)
        self.refresh()
        self._gains.value = f"./{safe_name(name)}"

    def _start(self, proposes: bool) -> None:
        """Judge the gains that flew, or propose better ones."""
        asked = vars(replace(self._damping.value, noise=float(self._noise.value))).values()
        margins = [word for option, x in zip(MARGINS, asked, strict=True) for word in parts.given(option, x)]
        words = ["tune", self._model.value, self._gains.value, *(margins if proposes else ())]
        self.project.start(
            "gains",
            lambda at: [*words, *(("-o", at) if proposes else ("--page", f"{at}/{PRODUCTS['gains']}"))],
        )

    def _turn(self) -> None:
        """Show the sliders and the last page of the chosen gains, and what goes on or failed after it."""
        chosen = [self._model.value, self._gains.value]
        # another file of the same name is not judged yet
        since = modified(self.project.root / (self._gains.value or ""))
        own = [
            step
            for step in self.project.steps("gains")
            if step.words[2:4] == chosen and modified(step.folder / COMMAND) >= since
        ]
        done = next((step for step in reversed(own) if step.state == "done"), None)
        after = [] if not own or own[-1] is done else self._unfinished(own[-1])
        sliders = [parts.html(parts.soft(BETTER)), pn.FlexBox(self._damping, self._noise), self._propose]
        self._stage[:] = [*(sliders if done else ()), *after, *(_page(done) if done else ())]

    def _unfinished(self, step: Step) -> list[Any]:
        if step.running:
            return self.waiting(step, SEARCHING if "-o" in step.words else "judging the loops")
        if ANYWAY not in step.error:
            return [parts.failed(step)]
        why = f"{step.error.rpartition('; ')[0]}. No file of gains was written."
        again = partial(self.project.start, "gains", lambda at: [*step.words[1:-1], at, ANYWAY])
        anyway = parts.button("Write them all the same", self.act(again))
        return [parts.html(parts.error(why) + parts.command(step)), anyway]


def _page(step: Step) -> list[Any]:
    """Return the page of a step, and the files of parameters that it wrote, in the order of trial flights."""
    found = sorted((p.name for p in step.files if p.suffix in ENDINGS), key=lambda name: (len(name), name))
    files = [f"{step.name}/{name}" for name in found]
    title = "Flown and proposed gains" if files else "Gains that flew"
    head = parts.html(f"<h2>{title}</h2>{parts.downloads(files)}{parts.command(step)}")
    return [head, parts.framed(f"{step.name}/{PRODUCTS['gains']}", title)]
