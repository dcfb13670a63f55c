"""Films of a run: how long they are, what they show where, and what is refused."""

from __future__ import annotations

import io
import itertools
import json
import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from experiments import benchmarks, simulate
from experiments.animations import files, film
from experiments.animations.arms import Arm, UnitArm
from experiments.animations.cart_pole import CartAndPole
from experiments.animations.drawing import Drawing
from experiments.animations.every import DRAWINGS, drawing_of
from experiments.animations.film import HEIGHT, LONGEST, RATE, WIDTH, Film, pace_of
from experiments.animations.masses import Masses
from experiments.animations.motion import Motion, motion_of
from experiments.animations.pendulum import HangingArm
from experiments.animations.quadrotor import Quadrotor
from experiments.runs.figures import of_draws
from mann_torch.plants import (
    PLANTS,
    CartPole,
    DoubleIntegrator,
    FlexibleJointArm,
    NLinkArm,
    Pendulum,
    PlanarQuadrotor,
    SlotineLiArm,
    TwoLinkArm,
)
from mann_torch.signals import Sinusoid
from mann_torch.simulation import Scenario
from tests.experiments.command import exit_code

QUIET = ("output.figures=false", "output.tensorboard=false")
ARM = ("controller=reallocating_initial", "horizon=0.5", "scenario.schedule.masses=[[0.25,2]]")


def moved(plant: Any, q: np.ndarray, moving: tuple[str, ...] = (), **more: Any) -> Motion:
    """A motion along coordinates (K, n), 0.05 s apart, that asks for 0.1 more of each output."""
    names = [channel.name for channel in plant.outputs]
    inputs = np.ones((len(q), len(plant.inputs)))
    arrays = {
        "t": 0.05 * np.arange(len(q)),
        "states": np.array(["q", "qd"]),
        "q": q,
        "reference": q[:, : len(names)] + 0.1,
        "input": more.pop("input", inputs),
        **{name: more.pop(name) for name in tuple(more) if name == "disturbance"},
    }
    parameters = {
        name: np.broadcast_to(row.numpy(), (len(q), row.shape[-1])).copy()
        for name, row in zip(plant.Parameters._fields, plant.parameters_of(**more), strict=True)
    }
    return Motion(plant, parameters, moving, arrays)


def drawn(kind: type[Any], motion: Motion, k: int) -> Any:
    """The drawing at sample k."""
    figure = Figure(figsize=(4, 3))
    FigureCanvasAgg(figure)
    drawing: Drawing = kind(figure.add_axes((0.1, 0.1, 0.8, 0.8)), motion, 1.0)
    drawing.show(k)
    return drawing


def walk(n: int, samples: int = 30) -> np.ndarray:
    return np.random.default_rng(n).uniform(-1.0, 1.0, (samples, n)).cumsum(0) / 4


def frames_of(data: bytes | Path) -> tuple[list[np.ndarray], list[float]]:
    """Pictures of a GIF, and how long each is seen [s]."""
    with Image.open(io.BytesIO(data) if isinstance(data, bytes) else data) as image:
        pictures, seconds = [], []
        for place in range(getattr(image, "n_frames", 1)):
            image.seek(place)
            pictures.append(np.asarray(image.convert("RGB")).astype(int))
            seconds.append(image.info["duration"] / 1000)
    return pictures, seconds


def test_a_run_leaves_a_film_of_its_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    told = (*ARM, *QUIET, "output.animation=true", "draws=2", "output.member=1", f"run_dir={run}")
    monkeypatch.chdir(tmp_path)
    assert exit_code(monkeypatch, simulate.main, *told) == 0
    assert json.loads((run / "metrics.json").read_text())["status"] == ["ok", "ok"]
    assert not [path for path in run.iterdir() if path.name.startswith(".animation")]
    pictures, seconds = frames_of(run / "animation.gif")
    assert len(pictures) == 11 and seconds == [0.05] * 11  # half a second, both ends of it
    assert all(picture.shape == (HEIGHT, WIDTH, 3) for picture in pictures)
    assert all(np.any(a != b) for a, b in itertools.pairwise(pictures))
    # What is white is white, and the payload, which is drawn in one colour, doubles.
    assert tuple(pictures[0][0, 0]) == (255, 255, 255)
    orange = [np.sum(np.abs(p - (200, 116, 42)).sum(-1) < 60) for p in (pictures[4], pictures[6])]
    assert 1.6 < orange[1] / orange[0] < 2.4


def test_frames_are_even_and_the_speed_is_what_is_written() -> None:
    for horizon, apart in (
        (0.4, 0.01),
        (10.0, 0.05),
        (15.0, 0.0555),
        (60.0, 0.05),
        (100.0, 0.03),
        (3600.0, 0.5),
    ):
        t = np.linspace(0.0, horizon, round(horizon / apart) + 1)
        pace = pace_of(t)
        shown, playing = t[list(pace.samples)], pace.delay * (len(pace.samples) - 1)
        assert playing <= LONGEST + 1e-9 and len(pace.samples) <= LONGEST * RATE + 1
        assert shown[-1] - shown[0] == pytest.approx(pace.speed * playing, abs=apart)
        assert np.ptp(np.diff(shown)) <= 2 * apart
        assert horizon - shown[-1] <= np.diff(shown).max()
        assert round(pace.delay * 1000) % 10 == 0  # a GIF counts hundredths of a second
    assert pace_of(np.linspace(0.0, 10.0, 201)).text == "real time"
    assert pace_of(np.linspace(0.0, 60.0, 1201)).text == "4 x real time"
    sparse = pace_of(np.linspace(0.0, 60.0, 31))  # no frame that no sample is for
    assert sparse.samples == tuple(range(31))
    assert pace_of(np.zeros(1)).samples == (0,)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_an_arms_end_is_where_its_angles_put_it(n: int) -> None:
    lengths = [0.5, 1.0, 0.7, 0.4][:n]
    plant = TwoLinkArm() if n == 2 else NLinkArm(n)
    motion = moved(plant, walk(n), lengths=lengths, masses=[1.0, 4.0, 2.0, 0.5][:n])
    drawing = drawn(Arm, motion, 17)
    for line, angles in ((drawing.links, motion.q), (drawing.ghost, motion.q + 0.1)):
        theta = np.cumsum(angles[17])
        ends = np.cumsum(np.array(lengths) * np.exp(1j * theta))
        x, y = line.get_data()
        np.testing.assert_allclose(x[1:] + 1j * y[1:], ends, atol=1e-12)
        assert x[0] == y[0] == 0.0
    areas = np.array([disc.get_radius() ** 2 for disc in drawing.discs])
    masses = motion.parameters["masses"][17]
    np.testing.assert_allclose(areas / areas.sum(), masses / masses.sum(), rtol=1e-12)
    trail = np.stack(drawing.path.get_data(), -1)
    assert len(trail) == 18 and drawing.behind == 30
    np.testing.assert_allclose(trail[-1], drawing.discs[-1].get_center(), atol=1e-12)


def test_a_centre_of_mass_is_where_it_is_on_its_link() -> None:
    drawing = drawn(Arm, moved(NLinkArm(2), walk(2), centers=[0.5, 0.25], inertias=[1, 1]), 3)
    (x0, x1, x2), _ = drawing.links.get_data()
    assert drawing.discs[0].get_center()[0] == pytest.approx(x0 + 0.5 * (x1 - x0))
    assert drawing.discs[1].get_center()[0] == pytest.approx(x1 + 0.25 * (x2 - x1))


def test_a_motor_points_where_its_spring_would_have_the_link() -> None:
    q = walk(4)
    motion = moved(FlexibleJointArm(2), q)
    drawing = drawn(Arm, motion, 5)
    for place, (before, motor) in enumerate(((0.0, q[5, 2]), (q[5, 0], q[5, 3]))):
        x, y = drawing.springs[place].get_data()
        angle = np.arctan2(np.diff(y), np.diff(x)) - (before + motor)
        assert np.abs(np.exp(1j * angle) - 1).max() < 1e-12
    assert len(drawing.links.get_data()[0]) == 3


def test_lumped_links_are_as_long_as_the_unit() -> None:
    drawing = drawn(UnitArm, moved(SlotineLiArm(), walk(2)), 4)
    steps = np.diff(np.stack(drawing.links.get_data(), -1), axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), 1.0, atol=1e-12)
    assert drawing.discs == []


def test_a_pendulum_hangs() -> None:
    motion = moved(Pendulum(), np.zeros((4, 1)), length=[0.7], mass=[3.0])
    x, y = drawn(HangingArm, motion, 2).links.get_data()
    np.testing.assert_allclose((x, y), ([0, 0], [0, -0.7]), atol=1e-15)


@pytest.mark.parametrize("followed", ["both", "position", "angle"])
def test_a_pole_stands_on_its_cart(followed: str) -> None:
    q = walk(2)
    motion = moved(CartPole(followed), q, length=[0.8])
    drawing = drawn(CartAndPole, motion, 7)
    (x0, x1), (y0, y1) = drawing.pole.get_data()
    assert (x0, y0) == (q[7, 0], 0.0)
    assert x1 - x0 == pytest.approx(0.8 * np.sin(q[7, 1]))
    assert y1 == pytest.approx(0.8 * np.cos(q[7, 1]))
    cart = drawing.cart
    assert cart.get_x() + 0.5 * cart.get_width() == pytest.approx(q[7, 0])
    assert drawing.wanted_cart.get_visible() == (followed != "angle")
    assert drawing.ghost.get_visible() == (followed != "position")


def test_the_view_goes_with_a_cart_that_goes_far() -> None:
    q = np.stack([np.linspace(0.0, 100.0, 40), np.zeros(40)], -1)
    drawing = drawn(CartAndPole, moved(CartPole(), q), 39)
    left, right = drawing.ax.get_xlim()
    assert left < 100.0 < right and right - left < 10.0


def test_a_quadrotor_with_its_thrusts_and_its_wind() -> None:
    q, wind = walk(3), np.linspace(0.0, -6.0, 30)[:, None]
    inputs = np.tile([9.81, 4.0, 2.0], (30, 1))
    motion = moved(PlanarQuadrotor(), q, input=inputs, disturbance=wind)
    drawing = drawn(Quadrotor, motion, 29)
    body = np.stack(drawing.body.get_data(), -1)
    np.testing.assert_allclose(body.mean(0), q[29, :2], atol=1e-12)
    slope = np.arctan2(*np.diff(body, axis=0)[0, ::-1])
    assert np.exp(1j * (slope - q[29, 2])) == pytest.approx(1.0)
    left, right, side = drawing.forces[29]
    assert right > left > 0 < side  # a moment > 0 turns to the left
    assert drawing.said.get_text() == "wind -6.0 m/s"
    tips = drawing.gust.get_xy()
    assert tips[:, 0].min() >= drawing.ax.get_xlim()[0]
    assert np.all(tips[:, 0] <= drawing.ax.get_xlim()[1])


def test_masses_are_on_their_rails() -> None:
    motion = moved(DoubleIntegrator(3), walk(3), masses=[1.0, 2.0, 4.0])
    drawing = drawn(Masses, motion, 11)
    for place, block in enumerate(drawing.blocks):
        assert block.get_x() + 0.5 * block.get_width() == pytest.approx(motion.q[11, place])
        assert drawing.targets[place].get_xdata()[0] == pytest.approx(motion.q[11, place] + 0.1)
    areas = [block.get_width() * block.get_height() for block in drawing.blocks]
    np.testing.assert_allclose(np.array(areas) / areas[0], [1.0, 2.0, 4.0])


def test_a_draw_that_was_lost_is_shown_until_then() -> None:
    plant = TwoLinkArm()
    scenario = Scenario(Sinusoid([0.1, 0.1], 1.0), plant.parameters_of(), 1.5)
    q = np.stack([walk(2), walk(2)], axis=1)
    q[12:, 1] = np.nan
    arrays = {"t": 0.05 * np.arange(30), "states": np.array(["q", "qd"]), "q": q}
    arrays |= {"input": q, "reference": q, "parameters": np.zeros((0, 2), str)}
    assert len(motion_of(plant, scenario, of_draws(arrays, 0), 0).t) == 30
    lost = motion_of(plant, scenario, of_draws(arrays, 1), 1)
    assert len(lost.t) == len(lost.parameters["masses"]) == 12 and np.isfinite(lost.q).all()


@pytest.mark.slow
def test_a_large_film_loses_frames_and_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Film(Arm, moved(TwoLinkArm(), walk(2, 12), ("masses",)), "an arm")
    whole = files.gif_of(shown)
    monkeypatch.setattr(files, "MOST_BYTES", len(whole) - 1)
    small = files.gif_of(shown)
    assert len(small) < len(whole)
    (pictures, seconds), (fewer, longer) = map(frames_of, (whole, small))
    assert len(fewer) == 6 and len(pictures) == 12
    assert sum(longer) == pytest.approx(sum(seconds))


@pytest.mark.slow
def test_benchmark_problems_have_films_where_there_are_drawings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "LONGEST", 0.5)
    told = ("problems=[slotine_li,scalar_mrac]", "halved=false", "workers=1", "run_dir=run")
    told += ("output.animation=true", *QUIET)
    assert exit_code(monkeypatch, benchmarks.main, *told) in (0, 1)  # half steps are not asked for
    made = sorted(path.name for path in (tmp_path / "run" / "figures").iterdir())
    assert made == ["slotine_li-adapting.gif", "slotine_li-fixed.gif"]
    report = (tmp_path / "run" / "report.md").read_text()
    assert all(f"(figures/{name})" in report for name in made)
    pictures, _ = frames_of(tmp_path / "run" / "figures" / made[0])
    assert len(pictures) == 11
    capsys.readouterr()
    assert exit_code(monkeypatch, benchmarks.main, "problems=[rohrs]", "output.animation=true") == 2
    assert "no drawing of RohrsPlant" in capsys.readouterr().err


def ffmpeg(folder: Path, script: str) -> None:
    """A program of that name, in a folder that is the whole search path."""
    program = folder / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)


@pytest.mark.slow
def test_an_mp4_is_made_by_ffmpeg_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    programs = tmp_path / "bin"
    programs.mkdir()
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    told = ("controller=reallocating_initial", "horizon=0.1", *QUIET, "output.animation=mp4")
    ffmpeg(programs, 'echo "$@" > asked.txt; for last; do :; done; cat > "$last"')
    assert exit_code(monkeypatch, simulate.main, *told, "run_dir=made") == 0
    assert (tmp_path / "made" / "animation.mp4").stat().st_size == 3 * WIDTH * HEIGHT * 4
    asked = (tmp_path / "asked.txt").read_text()
    assert f"-s {WIDTH}x{HEIGHT}" in asked and "-framerate 20.0" in asked and "-f mp4" in asked
    capsys.readouterr()
    ffmpeg(programs, 'cat > /dev/null; echo "no such codec" >&2; exit 3')
    assert exit_code(monkeypatch, simulate.main, *told, "run_dir=failed") == 1
    assert capsys.readouterr().err.strip().splitlines()[-1].startswith("error: ")
    left = {path.name for path in (tmp_path / "failed").iterdir()}
    assert "metrics.json" not in left and not any("animation" in name for name in left)


def test_what_cannot_be_drawn_is_one_line_and_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    for arguments, word in (
        (("problem=rohrs", "output.animation=true"), "no drawing of rohrs; there are those of"),
        (("problem=wing_rock", "output.animation=gif"), "no drawing of wing_rock"),
        (("problem=limited_input", "output.animation=true"), "no drawing of linear"),
        (("output.animation=mp4",), "needs the program ffmpeg"),
        (("output.animation=avi",), "output.animation = avi: choose from true"),
        (("output.animation=1",), "output.animation = 1: choose from true"),
        (("output.animation=[gif]",), "output.animation = ['gif']: choose from true"),
    ):
        assert exit_code(monkeypatch, simulate.main, *arguments) == 2
        out, err = capsys.readouterr()
        assert word in err and err.count("\n") == 1 and out == ""
    assert not any(tmp_path.iterdir())


def test_a_plant_of_ones_own_is_drawn_like_what_it_is_made_of() -> None:
    class Crane(CartPole):
        """One's own."""

    assert drawing_of(Crane()) is CartAndPole
    assert {name for name in PLANTS if PLANTS[name] in DRAWINGS} >= {
        *("two_link_arm", "n_link_arm", "flexible_joint_arm", "pendulum", "cart_pole"),
        "planar_quadrotor",
    }
    assert torch.is_tensor(Crane().points(torch.zeros(2).double(), Crane().parameters_of()))
