"""The command line: it parses, calls the pipeline's functions, and prints. It holds no logic.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from pipeline import cli_gains, cli_simulate
from pipeline.errors import ExitCode, GyrostandError

if TYPE_CHECKING:
    from pipeline.reproduce import Row
    from pipeline.runner import Outcome, Progress

app = typer.Typer(
    name="gyrostand",
    help="From gyroscope test-stand recordings to checked tables, quality figures and a verdict.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
plan_app = typer.Typer(help="Check a test plan, or begin one.", no_args_is_help=True, rich_markup_mode=None)
calibration_app = typer.Typer(
    help="Calibrations of gyros, to correct their records by.", no_args_is_help=True, rich_markup_mode=None
)
schema_app = typer.Typer(help="The contracts of the tables.", no_args_is_help=True, rich_markup_mode=None)
reproduce_app = typer.Typer(
    help="The papers' numbers, by our stages.", no_args_is_help=True, rich_markup_mode=None
)
app.add_typer(plan_app, name="plan")
app.add_typer(schema_app, name="schema")
app.add_typer(calibration_app, name="calibration")
app.add_typer(cli_simulate.app, name="simulate")
app.add_typer(reproduce_app, name="reproduce")
app.command()(cli_gains.gains)

Recording = Annotated[
    Path, typer.Argument(help="A recording: a file, or a rosbag2 folder.", show_default=False)
]
Recordings = Annotated[
    list[Path], typer.Argument(help="Recordings, or folders of recordings.", show_default=False)
]
PlanOption = Annotated[
    Path | None, typer.Option("--plan", help="Test plan; by default the one beside the recording.")
]
OutOption = Annotated[Path, typer.Option("--out", help="Output folder.")]
StrictOption = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="Fail a recording with any finding of severity error, such as a part that could not be read.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command()
def run(
    recording: Recording,
    out: OutOption,
    plan: PlanOption = None,
    recording_id: Annotated[
        str | None, typer.Option("--id", help="Name of the recording in the tables.")
    ] = None,
    strict: StrictOption = False,
    listed: Annotated[
        bool, typer.Option("--listed", help="RECORDING is a listing by 'discover', that names the recording.")
    ] = False,
    defer_verdict: Annotated[
        bool, typer.Option("--defer-verdict", help="Exit 0 once the tables are written; see 'verdicts'.")
    ] = False,
) -> None:
    """Take a recording through its procedure; write its tables; exit 0 if every limit is met."""
    from pipeline import runner

    if listed:
        from pipeline import discover

        recording = discover.listed(recording)
    with _progress(recording.name) as progress:
        outcome = runner.run(recording, out, plan, recording_id, progress)
    _print_outcome(outcome)
    if not defer_verdict:
        _finish([outcome], strict=strict)


@app.command()
def validate(recordings: Recordings, plan: PlanOption = None, strict: StrictOption = False) -> None:
    """Audit recordings and judge what the audit can judge; write nothing.

    One that cannot be judged does not hide the others; the exit code is the gravest.
    """
    from pipeline import discover, runner

    outcomes = []
    gravest = ExitCode.PASS
    for recording in discover.expand(recordings):
        try:
            with _progress(recording.name) as progress:
                outcome = runner.validate(recording, plan, progress)
        except GyrostandError as error:
            _complain(str(error))
            gravest = max(gravest, error.exit_code)
        else:
            _print_outcome(outcome)
            outcomes.append(outcome)
    if gravest:
        raise typer.Exit(gravest)
    _finish(outcomes, strict=strict)


@app.command()
def inspect(recording: Recording, as_json: JsonOption = False) -> None:
    """Show what a recording holds: topics, types, counts, rates, clocks, duration."""
    from pipeline import describe, formats

    inspection = formats.inspect(recording)
    typer.echo(
        json.dumps(describe.as_dict(inspection), indent=2) if as_json else describe.as_text(inspection)
    )


@app.command()
def check(paths: Annotated[list[Path], typer.Argument(help="Output folders or Parquet files.")]) -> None:
    """Verify page checksums, contracts, units, ranges, time and row counts of outputs."""
    from pipeline.storage.check import check as check_outputs

    faults = check_outputs(paths)
    for fault in faults:
        typer.echo(str(fault))
    if faults:
        raise typer.Exit(ExitCode.NOT_MET)
    typer.echo("all tables keep their contracts")


@app.command()
def report(
    out: Annotated[Path, typer.Argument(help="Output folder.")],
    recording: Annotated[
        str | None, typer.Option("--recording", help="Only this recording's page, by its id.")
    ] = None,
    index_only: Annotated[bool, typer.Option("--index", help="Only the index.")] = False,
) -> None:
    """Write one self-contained HTML page a recording, and their index."""
    from pipeline import storage
    from pipeline.report import page

    if not index_only:
        for name in [recording] if recording else storage.recordings(out):
            typer.echo(page.write_page(out, name))
    if not recording:
        typer.echo(page.write_index(out))


@app.command()
def verdicts(
    out: Annotated[Path, typer.Argument(help="Output folder.")], strict: StrictOption = False
) -> None:
    """Print the verdict of every recording below an output folder; exit 0 if every limit is met."""
    from pipeline import runner

    outcomes = runner.outcomes(out)
    for outcome in outcomes:
        typer.echo(_headline(outcome))
    _finish(outcomes, strict=strict)


@app.command()
def discover(folder: Annotated[Path, typer.Argument(help="Folder of recordings.")], out: OutOption) -> None:
    """Write make rules for every recording of a folder, under names that are safe for make."""
    from pipeline import discover as discovery

    typer.echo(discovery.write_rules(folder, out))


@plan_app.command("check")
def plan_check(file: Annotated[Path, typer.Argument(help="A test plan (TOML).")]) -> None:
    """Read a test plan and say whether it is right."""
    from pipeline import discover
    from pipeline.testplan import load_plan

    plan = load_plan(file)
    for recording in discover.recordings_of(file):
        plan.calibration(recording)
    typer.echo(
        f"{file}: procedure {plan.procedure}, streams {', '.join(plan.streams)}, {len(plan.limits)} limits"
    )


@plan_app.command("init")
def plan_init(recording: Recording) -> None:
    """Print a commented test plan made from what a recording holds."""
    from pipeline import formats
    from pipeline.testplan.initial import initial_plan

    typer.echo(initial_plan(formats.inspect(recording)), nl=False)


@calibration_app.command("export")
def calibration_export(
    out: Annotated[Path, typer.Argument(help="Output folder.")],
    recording: Annotated[
        str | None,
        typer.Option("--recording", help="Id of the calibrated recording; by default the only one."),
    ] = None,
) -> None:
    """Print the calibration of a recording as a file, which a test plan's gyro can name."""
    from pipeline.calibration_export import exported

    text, weak = exported(out, recording)
    typer.echo(text, nl=False)
    if weak:
        names = ", ".join(weak)
        typer.echo(f"gyrostand: warning: determined weakly or in combination only: {names}", err=True)


@schema_app.command("list")
def schema_list() -> None:
    """List the tables that have a contract."""
    from pipeline import contracts

    for name in contracts.names():
        typer.echo(f"{name:20} {contracts.contract(name).title}")


@schema_app.command("show")
def schema_show(table: Annotated[str, typer.Argument(help="A table's name.")]) -> None:
    """Print a table's contract."""
    from pipeline import contracts

    typer.echo(contracts.text(table), nl=False)


@reproduce_app.command("godorov")
def reproduce_godorov(as_json: JsonOption = False) -> None:
    """Reproduce the numbers of Godorov & Lutmanov (2016); exit 0 if all lie within their tolerance."""
    from pipeline import reproduce

    _print_figures(reproduce.godorov(), as_json=as_json)


@reproduce_app.command("gubarenko")
def reproduce_gubarenko(as_json: JsonOption = False) -> None:
    """Reproduce the numbers of Gubarenko & Kuzmenko (1995); exit 0 if all lie within their tolerance."""
    from pipeline import reproduce

    _print_figures(reproduce.gubarenko(), as_json=as_json)


@reproduce_app.command("panov")
def reproduce_panov(
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, help="Flights of each kind; the bounds are meant for 8.")
    ] = 8,
    as_json: JsonOption = False,
) -> None:
    """Reproduce the numbers of Panov (2007), and the filter's; exit 0 if all lie within their tolerance."""
    from pipeline import reproduce

    with _progress("panov") as progress:
        found = reproduce.panov(seeds, progress)
    typer.echo(json.dumps(found.as_dict(), indent=2) if as_json else found.as_text())
    _require_within(found.figures)


@reproduce_app.command("yang")
def reproduce_yang(as_json: JsonOption = False) -> None:
    """Reproduce the numbers of Yang et al. (2014); exit 0 if all lie within their tolerance."""
    from pipeline import reproduce

    _print_figures(reproduce.yang(), as_json=as_json)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; turn every error into one line and its exit code."""
    signal.signal(signal.SIGINT, _interrupt)
    try:
        app(args=arguments)
    except GyrostandError as error:
        _fail(str(error), error.exit_code)
    except _InterruptedError:
        _fail("interrupted; what was published is whole, run again to go on", 128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as fault:
        if os.environ.get("GYROSTAND_TRACEBACK"):
            raise
        if isinstance(fault, MemoryError):
            _fail(
                "memory: expected enough for what was asked, found too little"
                f"{f' ({fault})' if str(fault) else ''}; ask for fewer samples, or take a larger machine",
                ExitCode.FAULT,
            )
        _fail(
            f"internal fault: {type(fault).__name__}: {' '.join(str(fault).split())}; "
            "please report it with what GYROSTAND_TRACEBACK=1 prints",
            ExitCode.FAULT,
        )


class _InterruptedError(BaseException):
    """Ctrl-C. The command-line library would take Python's own for itself, and say nothing."""


def _interrupt(*_: object) -> NoReturn:
    raise _InterruptedError


def _fail(lines: str, code: int) -> NoReturn:
    _complain(lines)
    sys.exit(code)


def _complain(lines: str) -> None:
    for line in lines.splitlines():
        sys.stderr.write(f"gyrostand: {line}\n")


@contextmanager
def _progress(name: str) -> Iterator[Progress | None]:
    """Show the running stage on standard error, on a terminal only."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(stage: str, place: int, total: int) -> None:
        bar = "=" * place + ">" + " " * (total - place - 1)
        sys.stderr.write(f"\r\x1b[K{name!r} [{bar}] {stage}")
        sys.stderr.flush()

    try:
        yield show
    finally:
        sys.stderr.write("\r\x1b[K")


_SHOWN = 3
"""Findings of a kind and place that are printed; the page and the table have all."""


def _headline(outcome: Outcome) -> str:
    state = outcome.verdict + (" (up to date)" if outcome.up_to_date else "")
    errors = f"; {outcome.errors} of the findings are errors" if outcome.errors else ""
    return f"{outcome.recording_id}: {outcome.procedure}: {state}{errors}"


def _print_outcome(outcome: Outcome) -> None:
    """The verdict, the figures that have limits, and the findings that matter."""
    from pipeline.verdicts import limited

    typer.echo(_headline(outcome))
    for m in limited(outcome.metrics.to_pylist()):
        value = "none" if m["value"] is None else f"{m['value']:.6g}"
        low, high = (("" if m[k] is None else f"{m[k]:.6g}") for k in ("lower_limit", "upper_limit"))
        unit = "" if m["unit"] == "1" else f" {m['unit']}"
        typer.echo(f"  {m['verdict']:13} {m['channel']} {m['name']} = {value}{unit} [{low} … {high}]")
    kinds: dict[tuple[str, str, str, str], list[str]] = {}
    for f in outcome.findings.to_pylist():
        if f["severity"] != "info":
            place = f["stream"] if f["channel"] is None else f"{f['stream']}.{f['channel']}"
            kinds.setdefault((f["stage"], f["severity"], place, f["kind"]), []).append(f["detail"])
    for (_, severity, place, kind), details in kinds.items():
        for detail in details[:_SHOWN]:
            typer.echo(f"  {severity:13} {place}: {kind}: {detail}")
        if len(details) > _SHOWN:
            typer.echo(f"  {'':13} {place}: {kind}: {len(details) - _SHOWN} more, in the table findings")


def _print_figures(figures: Sequence[Row], *, as_json: bool) -> None:
    from pipeline import reproduce

    typer.echo(json.dumps(figures, indent=2) if as_json else reproduce.as_text(figures))
    _require_within(figures)


def _require_within(figures: Sequence[Row]) -> None:
    if not all(figure["within"] for figure in figures):
        raise typer.Exit(ExitCode.NOT_MET)


def _finish(outcomes: Sequence[Outcome], *, strict: bool) -> None:
    if any(o.verdict == "fail" or (strict and o.errors) for o in outcomes):
        raise typer.Exit(ExitCode.NOT_MET)
