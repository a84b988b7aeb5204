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
LONG = ["cds.ngc", "tort.ngc", "wave.gcode", "tiger.nc"]


def cases(short, long):
    return short + [pytest.param(name, marks=pytest.mark.campaign) for name in long]


@pytest.mark.parametrize("name", cases(SHORT, LONG))
def test_real_programs_pass_on_the_default_machine(name, corpus):
    result = Job.from_gcode(corpus / name).run()
    assert result.passed, result.text()


@pytest.mark.parametrize("name", cases(SHORT, LONG))
def test_real_programs_pass_on_pluto_step(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="pluto_step")
    assert result.passed, result.text()


@pytest.mark.parametrize("name", cases(SHORT[-2:], SHORT[:-2] + LONG[:2]))
def test_real_programs_pass_on_s3g(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="s3g")
    assert result.passed, result.text()


@pytest.mark.parametrize(
    "name", cases([SHORT[1], SHORT[5]], [SHORT[0], *SHORT[2:5], SHORT[6], *LONG])
)
def test_real_programs_pass_on_rapcores(name, corpus):
    result = Job.from_gcode(corpus / name).run(board="rapcores")
    assert result.passed, result.text()
