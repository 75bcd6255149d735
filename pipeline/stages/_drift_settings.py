"""Settings of the stage `identify`: the methods of a test plan, and what is known beforehand."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from pipeline.models.drift_regression import Quadrature
from pipeline.plan_faults import Fault, refuse
from pipeline.stages.base import Settings as _Settings

Method = Literal["cumulative", "gauss_newton", "segments", "filter", "transient", "spiral"]
Drift = Literal["m11", "m12", "m21", "m22", "mc1", "mc2"]


class Known(_Settings):
    """What is known of a drift parameter before the run."""

    value_deg_h: float = Field(0.0, description="its value, deg/h")
    sigma_deg_h: float = Field(gt=0, description="its standard deviation, deg/h")


class Settings(_Settings):
    """Which methods identify the gyro, and what is known beforehand."""

    methods: tuple[Method, ...] = Field(
        ("cumulative", "gauss_newton", "filter"), min_length=1, description="methods, side by side"
    )
    primary: Method | None = Field(
        None,
        description="method of the hold-out; None: transient where the drift settles, else gauss_newton",
    )
    installation_errors: bool = Field(
        True, description="whether the tilt of the rotor and the misalignment of the base are unknown"
    )
    quadrature: Quadrature = Field(
        "quintic_spline", description="how the model is integrated along the measured angles"
    )
    segment_length: int = Field(10, ge=2, description="grid intervals a segment, of the method segments")
    noise_arcsec: float | None = Field(
        None, gt=0, description="1 sigma of an angle on the grid, arcsec; None: from the residuals"
    )
    prior_drift_deg_h: float = Field(
        1.5, gt=0, description="1 sigma of every drift parameter before the run, deg/h"
    )
    prior_tilt_arcmin: float = Field(15.0, gt=0, description="1 sigma of the rotor's tilt, arcmin")
    prior_misalignment_arcmin: float = Field(
        1.5, gt=0, description="1 sigma of the base's misalignment about each axis, arcmin"
    )
    known: dict[Drift, Known] = Field(
        default_factory=dict, description="drift parameters that are known better, by name"
    )
    robust: bool = Field(True, description="whether samples far from the model are marked and left out")
    coloured: bool = Field(True, description="whether coloured residuals are recognised and allowed for")
    process_noise: Literal["none", "constant", "decaying"] = Field(
        "none", description="random walk of the drift that the filter allows for"
    )
    process_sigma: float = Field(
        0.1, gt=0, description="1 sigma of that walk over a unit of Earth-rate time (3.8 h), 1"
    )
    smooth: bool = Field(True, description="whether the filter is followed by the smoother")
    transient_hours: float | None = Field(
        None, gt=0, description="time in which the transient falls to 1/e, h; None: estimated by transient"
    )
    useful_drift_deg_h: float = Field(
        0.01, gt=0, description="standard error above which a drift parameter is not determined, deg/h"
    )
    useful_angle_arcmin: float = Field(
        1.0, gt=0, description="standard error above which an installation error is not determined, arcmin"
    )
    hold_out: float = Field(
        0.3,
        ge=0,
        lt=0.9,
        description="last part of each uninterrupted stretch, predicted with parameters from the rest",
    )
    advice: bool = Field(True, description="whether to compute which further run would determine more")
    instants: int = Field(500, ge=2, description="instants of each run at which estimates are given")

    @model_validator(mode="after")
    def _methods_fit_together(self) -> Self:
        if self.primary is not None and self.primary not in self.methods:
            expected = f"one of the methods of the plan: {', '.join(self.methods)}"
            refuse(
                [Fault(("primary",), expected, repr(self.primary), "add it to methods, or choose another")]
            )
        if self.primary == "spiral":
            expected = "a method that foretells the angles from all drift parameters"
            refuse(
                [Fault(("primary",), expected, "'spiral', a first guess", "choose another, or leave it out")]
            )
        if (
            self.process_noise == "decaying"
            and self.transient_hours is None
            and "transient" not in self.methods
        ):
            expected = "transient_hours beside process_noise = 'decaying', or the method transient"
            remedy = "say in how many hours the transient falls to 1/e, or add the method transient"
            refuse([Fault(("process_noise",), expected, "neither", remedy)])
        return self
