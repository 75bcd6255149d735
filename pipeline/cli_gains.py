"""``gyrostand gains``: what is known of the correction loops of navigation before anything is measured."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.errors import ExitCode, GyrostandError

if TYPE_CHECKING:
    from pipeline.models.correction_gains import LoopGains
    from pipeline.models.correction_response import Analysis, Reference

_GROUPS: Mapping[str, str] = MappingProxyType({"satellites": "gnss", "air": "air", "attitude": "attitude"})
"""Groups of gains in a test plan, and in the model."""

_FIX_UNITS: Mapping[str, str] = MappingProxyType({"position": "m", "velocity": "m/s"})


class Preset(StrEnum):
    """Gains ready made."""

    PRINTED = "printed"
    TUNED = "tuned"


class Between(StrEnum):
    """What references do between fixes."""

    PROPAGATED = "propagated"
    HELD = "held"
    HELD_DIFFERENCE = "held_difference"


_BETWEEN: Mapping[Between, Reference] = MappingProxyType(
    {Between.PROPAGATED: "propagated", Between.HELD: "held", Between.HELD_DIFFERENCE: "held_difference"}
)


class GainError(GyrostandError):
    """A gain on the command line is not one."""

    exit_code = ExitCode.USAGE


def gains(
    plan: Annotated[
        Path | None, typer.Argument(help="A test plan of procedure navigation.", show_default=False)
    ] = None,
    preset: Annotated[
        Preset | None,
        typer.Option(help="Gains ready made, in the place of a test plan's; tuned without one."),
    ] = None,
    gain: Annotated[
        list[str] | None,
        typer.Option(
            help="A gain of its own, GROUP.NAME=VALUE in s and 1/s, such as 'satellites.k_n=0.05'; groups "
            "satellites (T T_V k_L k_V K k_LV k_n), air (T_V k_V K), attitude (T_U k_U K_U k_omega); "
            "repeatable."
        ),
    ] = None,
    rate: Annotated[
        float, typer.Option(min=1e-3, max=1e6, help="Samples of the inertial sensors a second.")
    ] = 100.0,
    interval: Annotated[
        float, typer.Option(min=1e-3, max=1e6, help="Between fixes of the satellites, s.")
    ] = 1.0,
    references: Annotated[
        Between | None,
        typer.Option(help="What references do between fixes; a test plan's, or propagated without one."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Print limits, poles, damping, settling time and noise gain of the loops; exit 2 if one is not stable.

    Settling time: until 5 % is left of a constant bias, or, where it is frozen, of an error of the velocity.
    Noise gain: of the navigated at a fix by white noise of the fixes, standard deviations.
    """
    from pipeline.models.correction_gains import channels
    from pipeline.models.correction_response import Sampling, analyse, check

    chosen, reference = _chosen(plan, preset, references)
    chosen = _with(chosen, gain or ())
    samplings = []
    for channel in channels(chosen):
        by_satellites = bool({"position", "velocity"} & set(channel.driven_by))
        between: Reference = "propagated" if "attitude" in channel.driven_by else reference
        step = 1.0 / rate
        samplings.append(
            (channel, Sampling(step=step, interval=interval if by_satellites else step, reference=between))
        )
    analyses = [analyse(channel, **sampling) for channel, sampling in samplings]
    if as_json:
        typer.echo(
            json.dumps([_as_dict(a, s["interval"]) for a, (_, s) in zip(analyses, samplings, strict=True)])
        )
    else:
        for analysis, (_, sampling) in zip(analyses, samplings, strict=True):
            typer.echo("\n".join(_as_lines(analysis, sampling["interval"])))
    for channel, sampling in samplings:
        check(channel, **sampling)


def _chosen(
    plan: Path | None, preset: Preset | None, references: Between | None
) -> tuple[LoopGains, Reference]:
    """Gains and reference of the plan, unless options say otherwise."""
    from pipeline.models.correction_gains import PRINTED, TUNED

    found = PRINTED if preset is Preset.PRINTED else TUNED
    reference: Reference = "propagated"
    if plan is not None:
        from pipeline.stages.navigate import Settings
        from pipeline.testplan import load_plan

        checked = load_plan(plan)
        section = checked.settings.get("navigate")
        if not isinstance(section, Settings):
            raise GainError(
                repr(str(plan)),
                expected="a test plan of procedure navigation",
                found=f"procedure {checked.procedure}",
                remedy="name one, or give the gains as options",
            )
        reference = section.loops.references
        if preset is None:
            found = section.loops.loop_gains
    return found, reference if references is None else _BETWEEN[references]


def _with(chosen: LoopGains, texts: Sequence[str]) -> LoopGains:
    """The gains, with those that are given by themselves."""
    from dataclasses import fields, replace

    for text in texts:
        name, _, value = text.partition("=")
        group, _, symbol = name.strip().partition(".")
        held = getattr(chosen, _GROUPS[group]) if group in _GROUPS else None
        known = [] if held is None else [f.name for f in fields(held)]
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if held is None or symbol not in known or not math.isfinite(number):
            raise GainError(
                "--gain",
                expected=f"GROUP.NAME=VALUE, GROUP of {', '.join(_GROUPS)}"
                + (f", NAME of {', '.join(known)}" if known else ""),
                found=repr(text),
                remedy="for example 'satellites.k_n=0.05'",
            )
        chosen = replace(chosen, **{_GROUPS[group]: replace(held, **{symbol: number})})
    return chosen


def _gains_of(analysis: Analysis) -> Iterator[tuple[str, float, str]]:
    """Name, value and unit of the gains that a channel has a use for."""
    channel = analysis.channel
    g, (T_V, k_V, K, k_n) = channel.gains, channel.symbols
    if channel.measured != "velocity":
        yield from (("T", g.T, "s"), ("k_L", g.k_L, "1"), ("k_LV", g.k_LV, "1/s"))
    if channel.measured != "position":
        yield from ((T_V, g.T_V, "s"), (k_V, g.k_V, "1"))
    yield K, g.K, "1/s"
    if not channel.frozen:
        yield k_n, g.k_n, "1/s"


def _as_lines(analysis: Analysis, interval: float) -> Iterator[str]:
    channel = analysis.channel
    yield f"{channel.name}, compared each {interval:g} s" + (", bias frozen" if channel.frozen else "")
    listed = (
        f"{name} = {value:g}" + ("" if unit == "1" else f" {unit}")
        for name, value, unit in _gains_of(analysis)
    )
    yield f"  gains            {', '.join(listed)}"
    if not channel.frozen:
        yield f"  limit            {channel.symbols[-1]} < {analysis.limit:.4f} 1/s"
    yield f"  poles            {', '.join(_written(p) for p in analysis.poles if p.imag >= 0)} 1/s"
    yield f"  damping          {analysis.damping:.3f}"
    yield f"  settling time    {analysis.settling_time:.1f} s"
    yield f"  spectral radius  {analysis.radius:.4f}" + ("" if analysis.radius < 1 else ": NOT STABLE")
    for (source, output), size in analysis.noise_gain.items():
        unit = "" if source == output else f" ({_FIX_UNITS[output]})/({_FIX_UNITS[source]})"
        yield f"  noise gain       {size:.3f}{unit} from {source} to {output}"


def _written(p: complex) -> str:
    return f"{p.real:.4f}" + (f" ± {abs(p.imag):.4f}i" if p.imag else "")


def _as_dict(analysis: Analysis, interval: float) -> dict[str, Any]:
    channel = analysis.channel
    return {
        "loop": channel.name,
        "bias": "frozen" if channel.frozen else "estimated",
        "interval": {"value": interval, "unit": "s"},
        "gains": {name: {"value": value, "unit": unit} for name, value, unit in _gains_of(analysis)},
        "limit": None
        if channel.frozen
        else {"of": channel.symbols[-1], "value": analysis.limit, "unit": "1/s"},
        "poles": [[p.real, p.imag] for p in analysis.poles],
        "sampled_poles": [[_finite(p.real), p.imag] for p in analysis.sampled_poles],
        "spectral_radius": _finite(analysis.radius),
        "damping": analysis.damping,
        "settling_time": {"value": _finite(analysis.settling_time), "unit": "s"},
        "noise_gain": [
            {"from": source, "to": output, "value": _finite(size)}
            for (source, output), size in analysis.noise_gain.items()
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
