"""Real programs of other people, through the whole main job, to a passed verdict."""

import pytest

from pulsewright.app.run import Job

SHORT = [
    "arcspiral.ngc",
    "circle_small_segments_ncd.ngc",
    "contour.ngc",
    "trochoidal.ngc",
    "vcarve.ngc",
    "wheels.ngc",
    "zigzag_0.002_0.001.ngc",
]
LONG = ["cds.ngc", "tort.ngc"]
LONGER = ["wave.gcode", "tiger.nc"]  # 48 million steps; hours of machine time


def cases(short, campaign, marathon=()):
    """Return programs for the default run, for the campaign, and for a run by hand."""
    return (
        short
        + [pytest.param(name, marks=pytest.mark.campaign) for name in campaign]
        + [pytest.param(name, marks=pytest.mark.marathon) for name in marathon]
    )


@pytest.mark.parametrize("name", cases(SHORT, LONG + LONGER))
def test_real_programs_pass_on_the_default_machine(name, corpus):
    result = Job.from_gcode(corpus / name).run()
    assert result.passed, result.text()


@pytest.mark.parametrize("name", cases(SHORT, [*LONG, LONGER[0]], LONGER[1:]))
def test_real_programs_pass_on_pluto_step(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="pluto_step")
    assert result.passed, result.text()


@pytest.mark.parametrize("name", cases(SHORT[-2:], SHORT[:-2] + LONG, LONGER))
def test_real_programs_pass_on_s3g(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="s3g")
    assert result.passed, result.text()


@pytest.mark.parametrize(
    "name",
    cases(
        [SHORT[1], SHORT[5]],
        [SHORT[0], *SHORT[2:5], SHORT[6], *LONG, LONGER[0]],
        LONGER[1:],
    ),
)
def test_real_programs_pass_on_rapcores(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="rapcores")
    assert result.passed, result.text()
