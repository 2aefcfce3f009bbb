"""``aircraft-sysid``: one command line for everything."""

from __future__ import annotations

import argparse
import gc
import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from aircraft_sysid_ros import __version__
from aircraft_sysid_ros.errors import IncompleteError, InputError, echo, without_control
from aircraft_sysid_ros.installation import unmet_requirement
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.processes import ONE_THREAD
from aircraft_sysid_ros.spelling import did_you_mean

#: Command, the module that has it and its purpose, in the order in which a user meets them.
COMMANDS = {
    "demo": ("demo", "the main job on a simulated flight, through ROS 2"),
    "explain": ("explain", "what a log means, in one go, on one page"),
    "simulate": ("simulate", "a flight with known truth, recorded as a bag"),
    "import": ("import_log", "a flight log of another format to a bag"),
    "check": ("check", "the data of a flight, before anything is estimated"),
    "calibrate": ("calibrate", "errors of a probe, a magnetometer, or of IMU and air data, from a flight"),
    "replay": ("replay", "the whole pipeline over a recording"),
    "compare": ("compare", "how good the model is, and where it fails"),
    "diagnose": ("diagnose", "which effect is missing"),
    "add": ("add", "an effect or a term added to the model, with the error before and after"),
    "remove": ("remove", "an effect or a term taken out again"),
    "name": ("name", "a name and a note for a version of the model"),
    "export": ("export", "the model of a run as a file of another program"),
    "gains": ("gains", "first gains of an autopilot's rate loops"),
    "workbench": ("workbench", "the same on a web page on this machine, with a mouse"),
    "report": ("report", "the page of a run as one HTML file"),
    "fleet": ("fleet", "many flights at once, and what changes between them"),
    "refine": ("refine", "maximum likelihood on a run, after the flight"),
    "polar": ("polar", "the drag polar and the power of level flight, from the energy of a flight"),
    "play": ("play", "a recording onto ROS 2 topics"),
    "live": ("live", "all nodes on ROS 2 topics"),
    "recover": ("recover", "the run of a flight that a crash or a power cut ended"),
    "bridge": ("bridge", "an autopilot's MAVLink onto ROS 2 topics"),
}
#: What a library raises where it was given too much or what cannot be, by the name of the error: the sentence.
BEYOND = {
    "RecursionError": "the input is nested too deeply: simplify it",
    "MemoryError": "the input needs more memory than there is: give less, such as a shorter flight",
    "LinAlgError": "the input gives equations without a solution: `aircraft-sysid check` says what is wrong with a "
    "flight; check the numbers of the aircraft file, too",
}
BAD_INPUT = 2
FAILED = 1
STOPPED = 130
#: Environment variable that shows the traceback of what should not have happened.
TRACEBACK = "AIRCRAFT_SYSID_TRACEBACK"
#: Words of ROS at the end of a line, such as remaps, and the commands with nodes, which take them.
_ROS, _OF_ROS = "--ros-args", ("bridge", "live", "play")


class _Parser(argparse.ArgumentParser):
    """Bad options are bad input: one line, exit status 2, with the word that was meant where one is near."""

    known: Sequence[str] = ()  # options of the command that was given
    command = ""  # that command: what it does not know, this parser refuses
    given: Sequence[str] = ()  # words of the command line

    def error(self, message: str) -> Any:
        message = f"{_in_words(message)}{self._meant(message)}"
        prog = f"{self.prog} {self.command}".rstrip()
        self.exit(BAD_INPUT, f"{prog}: {message}; see {prog} --help\n")

    def _meant(self, message: str) -> str:
        """Of a command, a choice or an option that is not there the nearest that is."""
        if found := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message):
            hint = did_you_mean(found[1], [choice.strip("' ") for choice in found[2].split(",")])
        elif found := re.search(r"unrecognized arguments: (--[\w-]+)", message):
            hint = did_you_mean(found[1], self.known)
        else:
            hint = self._misspelt(re.findall(r"--[\w-]+", message.partition("arguments are required: ")[2]))
        return f": {hint}" if hint else ""

    def _misspelt(self, required: Sequence[str]) -> str:
        """Of an option that is required the word that was given for it."""
        options = (word.partition("=")[0] for word in self.given if word.startswith("--"))
        unknown = [option for option in options if not any(each.startswith(option) for each in self.known)]
        hints = (did_you_mean(each, required).replace("?", f" in place of {each}?") for each in unknown)
        return next(filter(None, hints), "")


def _in_words(message: str) -> str:
    """A message of argparse without the types of Python."""
    message = re.sub(r"invalid int value: ('.*')", r"\1 is not a whole number", message)
    return re.sub(r"invalid float value: ('.*')", r"\1 is not a number", message)


def build_parser(command: str | None, given: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Parser of one command, or of all by name alone: modules are imported only where they are used.

    ``given``: the words that it will parse, for what may have been meant by one of them.
    """
    parser = _Parser(
        prog="aircraft-sysid",
        description="Online adaptive system identification of aircraft, on ROS 2.",
    )
    parser.add_argument("--version", action="version", version=f"aircraft-sysid {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module_name, purpose) in COMMANDS.items():
        if name != command:
            subparsers.add_parser(name, help=purpose)
            continue
        module = import_module(f"aircraft_sysid_ros.commands.{module_name}")
        subparser = module.add_parser(subparsers)
        subparser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
        if name in _OF_ROS:
            subparser.add_argument(
                _ROS,
                nargs=argparse.REMAINDER,
                metavar="WORD",
                help="ROS arguments up to the end of the line, such as -r imu/data:=/driver/imu",
            )
        parser.known, parser.command = [*subparser._option_string_actions], name
        subparser.known, subparser.given = parser.known, given
        subparser.set_defaults(module=module, prog=f"{parser.prog} {command}")
    return parser


@contextmanager
def _libraries_on_standard_error() -> Iterator[None]:
    """Standard output is for the answer alone: the middleware of ROS writes its complaints there, too."""
    try:
        kept = os.dup(1)
    except OSError:  # it is closed
        yield
        return
    try:
        os.dup2(2, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    if arguments is not None:
        return _run(arguments)
    os.environ.update({**ONE_THREAD, **os.environ})
    gc.disable()  # until all is imported, see `_parsed`
    try:
        return _run(sys.argv[1:])
    finally:
        gc.freeze()  # the system takes the memory: nothing is to be looked through once more


def _parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """Options of the command; what it imports stays to the end of the process and is spared by the collector."""
    command = next((word for word in arguments if not word.startswith("-")), None)
    own, ros = [*arguments], []
    if command in _OF_ROS and _ROS in own:  # up to the end, or to what ROS ends its own words with
        begin = own.index(_ROS)
        end = own.index("--", begin) if "--" in own[begin:] else len(own)
        own, ros = own[:begin] + own[end + 1 :], own[begin:end]
    args = build_parser(command, own).parse_args(own)
    args.ros_args = ros
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
    return args


def _run(arguments: Sequence[str]) -> int:
    try:
        args = _parsed(arguments)
    except KeyboardInterrupt:  # while modules are imported
        print("aircraft-sysid: stopped", file=sys.stderr)
        return STOPPED
    except ImportError as error:
        return _failed("aircraft-sysid", error)
    status = 0
    try:
        with _libraries_on_standard_error(), warnings.catch_warnings():
            if not (sys.warnoptions or os.environ.get(TRACEBACK)):  # NaN says it
                warnings.simplefilter("ignore", RuntimeWarning)
            result = args.module.run(args)
    except IncompleteError as error:
        print(f"{args.prog}: {error}", file=sys.stderr)
        result, status = error.result, FAILED
    except InputError as error:
        print(f"{args.prog}: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"{args.prog}: stopped", file=sys.stderr)
        return STOPPED
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        print(f"{args.prog}: the system refused{where}: {error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        if _was_stopped(error):
            print(f"{args.prog}: stopped", file=sys.stderr)
            return STOPPED
        return _failed(args.prog, error)
    try:
        print(json_text(result) if args.json else without_control(args.module.render(result)))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"{args.prog}: the answer cannot be written: {error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    return status


def _was_stopped(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind it: within a compiled kernel it becomes a SystemError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _failed(prog: str, error: Exception) -> int:
    """Say what should not have happened, or the required package that it comes from; returns the exit status."""
    if os.environ.get(TRACEBACK):
        raise error
    if unmet := unmet_requirement():
        print(f"{prog}: {unmet}", file=sys.stderr)
        return BAD_INPUT
    for kind in type(error).__mro__:
        if kind.__name__ in BEYOND:
            print(f"{prog}: {BEYOND[kind.__name__]}", file=sys.stderr)
            return BAD_INPUT
    text = echo(f"{type(error).__name__}: {error}", 400)
    print(f"{prog}: failed, {text} ({TRACEBACK}=1 shows where)", file=sys.stderr)
    return FAILED


if __name__ == "__main__":
    sys.exit(main())
