"""The entry point: find the verb, import only its module, turn errors into one line and a code.

Exit codes: 0 done, 1 a bug in stoop, 2 an error that the user can correct, 3 done with new alarms of a fleet, 130 interrupted
(Ctrl-C or SIGTERM), 141 nobody reads the output any more.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import errno
import gc
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise, takewhile
from typing import Any, Final, NoReturn

from stoop.base.cache import fonts_folder
from stoop.base.files import recorded_inputs
from stoop.base.interrupts import restore_interrupts, unblock_interrupts
from stoop.base.memory import keep_freed_memory
from stoop.base.packages import PREFIX, culprit, guarded, others
from stoop.base.streams import flush_or_discard, open_missing_streams
from stoop.base.text import nearest, printable, show
from stoop.base.verbs import Verb, add_options, verbs
from stoop.cli.options import check_outputs
from stoop.errors import StoopError, StoopWarning

GARBAGE: Final = 50_000  #: new objects until cycles are looked for; with 700 it took a tenth of the time
BUG, USER_ERROR, INTERRUPTED, UNREAD = 1, 2, 130, 141
BUG_MESSAGE = "this is a bug in stoop{}: please report it with the lines above and your command"
#: of a write, which names no file
OUTPUT_ERRORS: Final = {errno.EBADF, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOSPC}
#: least resemblance of options; names resemble each other by their two dashes already
OPTION_CUTOFF: Final = 0.7
DEBUG_HELP = "show the traceback of every error (or set STOOP_DEBUG=1)"
EXAMPLES: Final = """\
examples:
  stoop demo
  stoop info LOG.ulg
  stoop identify LOG.ulg --vehicle V.toml --maneuver 140:145 -o result

Help on a verb: stoop VERB --help"""


class Parser(argparse.ArgumentParser):
    """A parser that complains in one line, as the rest of stoop does."""

    verbs: Mapping[str, Parser]  #: name -> parser of a verb; of the whole command only

    def print_help(self, file: Any = None) -> None:
        """Print the help; argparse itself says nothing where it cannot be written."""
        show(self.format_help().rstrip("\n"), file)

    def error(self, message: str) -> NoReturn:
        """Print one line and leave with code 2 (the hook that argparse documents for this)."""
        raise SystemExit(_complain(f"error: {printable(message)} (see {self.prog} --help)", USER_ERROR))


class _Version(argparse.Action):
    """Look the version up only when it is asked for: importlib.metadata is slow to import."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        show(f"stoop {version('stoop')}")
        parser.exit()


def main(given: Sequence[str] | None = None) -> int:
    """Run the command line with the arguments `given`, by default those of the process; return the exit code."""
    if given is None:
        given = sys.argv[1:]
        gc.set_threshold(GARBAGE)
        keep_freed_memory()
        # else the interpreter looks through all objects, half a second, before it leaves
        atexit.register(gc.freeze)
        open_missing_streams()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # an output that takes any character
                stream.reconfigure(errors="backslashreplace")
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:  # of a system that goes down: as Ctrl-C
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        if not sys.warnoptions and "--debug" not in given:
            warnings.simplefilter("ignore")  # of libraries
            warnings.simplefilter("default", StoopWarning)
            warnings.formatwarning = lambda message, *_, **__: f"stoop: warning: {printable(str(message))}\n"
    debug = "--debug" in given or bool(os.environ.get("STOOP_DEBUG"))
    try:
        unblock_interrupts()
        return _guarded(given, debug)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        flush_or_discard(sys.stdout)
        return UNREAD
    except (OSError, MemoryError) as error:  # a full disk, an output that went away, a log without end
        if debug:
            _print_traceback()
        flush_or_discard(sys.stdout)
        return _complain(f"error: {_lacking(error)}", USER_ERROR)
    except Exception as error:
        # of a C library without memory
        if isinstance(error, SystemError) and "without exception set" in str(error):
            return _complain(f"error: {_lacking(MemoryError())}", USER_ERROR)
        _print_traceback()
        return _complain(BUG_MESSAGE.format("".join(f" or in {name}" for name in others())), BUG)


def _guarded(given: Sequence[str], debug: bool) -> int:
    """Parse, run the verb, report errors of the user, and flush the output."""
    try:
        # A window that begins before zero (-5:5) is protected by a blank, so that argparse takes it for no option.
        words = one_verb([f" {word}" if re.match(r"-[\d.]+:", word) else word for word in given])
        with restore_interrupts():
            parser = parser_for(words)
            _check_names(parser, words)
            arguments, unknown = parser.parse_known_args(words)
            if unknown:
                arguments.complain(f"unrecognized arguments: {' '.join(unknown)}")
            with contextlib.suppress(OSError):  # no folder of temporary files: Matplotlib does without
                # its list of fonts lies where stoop keeps compiled code: a verb writes nowhere else
                os.environ.setdefault("MPLCONFIGDIR", str(fonts_folder()))
            code = int(arguments.run(arguments))
    except SystemExit as leaving:  # argparse leaves this way after --help and after errors
        left = leaving.code or 0
        code = left if isinstance(left, int) else _complain(f"error: {left}", USER_ERROR)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and str(error.name).startswith(PREFIX):
            error = StoopError(f"this needs the package {error.name}; install stoop anew")
        if (known := error if isinstance(error, StoopError) else culprit(error)) is None:
            raise
        if debug:
            _print_traceback()
        # The first line is the error; more lines are a file to start from, for the user to redirect.
        message, *attached = "".join(map(str, known.args)).splitlines() or [type(error).__name__]
        code = _complain(f"error: {message}", USER_ERROR)
        for line in attached:
            show(line)
        flush_or_discard(sys.stdout)  # one error is enough, where the output cannot be written either
    sys.stdout.flush()
    return code


def one_verb(given: Sequence[str]) -> list[str]:
    """Join the two words of a verb such as ``vehicle new``."""
    for i, pair in enumerate(pairwise(given)):
        if not pair[0].startswith("-"):
            joined = " ".join(pair)
            return [*given[:i], joined, *given[i + 2 :]] if joined in verbs() else list(given)
    return list(given)


def parser_for(given: Sequence[str]) -> Parser:
    """Return a parser that knows every verb by name and the arguments of the chosen one."""
    given = one_verb(given)
    chosen = _verb(given)
    known = verbs()
    parser = Parser(
        prog="stoop",
        usage="stoop [-h] [--version] [--debug] VERB ...",
        description="From a flight log to a flight-dynamics model one can trust.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_argument("--debug", action="store_true", help=DEBUG_HELP)
    listed = "\n".join(f"{name:<13} {verb.summary}" for name, verb in known.items())
    # The list in the description is better laid out than argparse's own.
    added = parser.add_subparsers(
        prog="stoop", title="verbs", metavar="VERB", required=True, help=argparse.SUPPRESS, description=listed
    )
    for name, verb in known.items():
        summary = f"{verb.summary[0].upper()}{verb.summary[1:]}."
        one = added.add_parser(name, description=summary, allow_abbrev=False)
        if name == chosen:
            add_options(one, verb.options)
            if verb.epilog:
                one.formatter_class, one.epilog = argparse.RawDescriptionHelpFormatter, verb.epilog
            one.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=DEBUG_HELP)
            one.set_defaults(run=partial(_run, verb), complain=one.error)
    parser.verbs = added.choices
    return parser


def _run(verb: Verb, arguments: argparse.Namespace) -> int:
    """Import the function of a verb, or of an option that runs it instead; with ``--overwrite`` it replaces nothing it reads."""
    given = {one.run: getattr(arguments, one.key) for one in verb.options if one.run}
    runs = [run for run, value in given.items() if value not in (None, False, [])]
    with recorded_inputs() if hasattr(arguments, "overwrite") else contextlib.nullcontext():
        check_outputs(verb.options, arguments)
        code = guarded((*runs, verb.run)[0], int | None)(arguments)
        return code or 0


def _verb(words: Sequence[str]) -> str | None:
    return next((word for word in words if not word.startswith("-")), None)


def _check_names(parser: Parser, words: Sequence[str]) -> None:
    """Leave with an error that suggests another name if the verb or a long option is unknown.

    argparse lists all verbs, and of a mistyped option it says first that the right one is required.
    """
    name = _verb(words)
    if name is not None and name not in parser.verbs:
        parser.error(f"there is no verb '{name}'; {nearest(name, parser.verbs)}")
    at = len(words) if name is None else words.index(name)
    _check_options(parser, words[:at])
    if name is not None:
        _check_options(parser.verbs[name], words[at:])


def _check_options(parser: Parser, words: Sequence[str]) -> None:
    known = [option for option in parser._option_string_actions if option.startswith("--")]
    for word in takewhile("--".__ne__, words):
        option = word.partition("=")[0]
        if option.startswith("--") and " " not in word and option not in known:  # no value, for argparse
            parser.error(f"there is no option {option}; {nearest(option, known, OPTION_CUTOFF)}")


def _complain(message: str, code: int) -> int:
    show(f"stoop: {printable(message)}", sys.stderr)
    return code


def _print_traceback() -> None:
    import traceback

    show(traceback.format_exc(), sys.stderr)


def _lacking(error: OSError | MemoryError) -> str:
    """Say what the machine lacks, and what to do where that is not plain."""
    if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
        return "the memory is not enough for this; give less data"
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return "too many open files for this process; allow it more (ulimit -n)"
    named = error.filename or ("the output" if error.errno in OUTPUT_ERRORS else "this system")
    return f"{named}: {error.strerror or error}"
