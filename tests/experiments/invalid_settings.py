"""Settings that no command can use, made at random: every leaf of every command is spoiled."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from experiments.command.cli import compose_job

COMMANDS = (
    *("simulate", "ensemble", "reproduce", "tune", "gradient_report", "peers", "ablation"),
    *("online_regression", "tune_problems", "returning", "export"),
)
#: How often each is asked: the quick ones more.
SHARE = (6, 4, 2, 3, 4, 5, 3, 5, 2, 2, 3)
#: Numbers that may be anything finite, or that nothing computes with.
_ANY_SIGN = (
    *("amplitude", "frequency", "offset", "q", "qd", "paper", "paper_reduction", "phase"),
    *("weights", "velocities", "accelerations", "centers", "times", "gravity", "start"),
)
#: Sizes that no machine has room for, and counts that no one lives to see the end of.
_SIZES = (
    "draws",
    "memory.n_slots",
    "controller.n_hidden",
    "pairs",
    "gradient.pairs",
    "schedule.iterations",
    "workers",
    "seeds",
    "rollouts",
    "chunk",
    "batch",
    "n_slots",
    "n_hidden",
    "hidden_size",
    "iterations",
    "visits",
    *("tested", "evaluated", "recall.batch", "recall.n_keys", "copy.iterations", "copy.length"),
    *("gap.longest", "returning.steps", "recall.iterations", "recall.seeds"),
    *("arm.draws", "arm.visits", "online.seeds", "online.visits"),
)
#: Commands of one scenario of one loop, and other loops than the default one.
OF_LOOPS = ("simulate", "ensemble", "gradient_report")
LOOPS = (
    (
        *("plant=pendulum", "scenario=plain", "controller=linear_feedback", "actuator=lagged"),
        *("sensor=sampled", "clock=periodic", "model=second_order", "disturbance=input"),
        *("reference=square_wave", "sensor.noise={std:[1e-3,1e-2],rate:100.0,seed:3}"),
    ),
    (
        *("plant=n_link_arm", "scenario=plain", "reference=sinusoid", "network=radial_basis"),
        *("law=gradient", "sensor=noisy", "actuator=limited"),
    ),
    ("plant=wing_rock", "scenario=plain", "controller=linear_feedback", "reference=smooth_steps"),
    ("plant=planar_quadrotor", "scenario=plain", "controller=nn", "disturbance=wind"),
    ("problem=wing_rock_concurrent", "controller.robust={sliding_gain:0.5,layer:0.1}"),
    ("problem=quadrotor_learned", "controller.integral={integral_gain:0.2}"),
    ("problem=limited_input", "law.least_squares={initial_gain:1.0}", "law.constant=null"),
    ("plant=slotine_li_arm", "scenario=plain", "controller=slotine_li", "law=sigma"),
)
#: What only goes wrong together.
TOGETHER = {
    "simulate": (
        ("solver=implicit", "solver.rtol=1e-3"),
        ("solver=dopri5", "solver.follow_reference=false"),
        ("solver=rk4", "solver.atol=1e-3"),
        ("solver=dopri5", "solver.max_step=1e-4"),
        ("scenario.schedule.masses=[[1,1e200],[2,1e200]]",),
        ("scenario.schedule.masses=[[1,1e-200],[2,1e-200]]",),
        ("scenario.schedule.masses=[[true,2]]",),
        ("scenario.schedule.masses=[[1,true]]",),
        ("scenario.schedule.masses=[{every:1,growth:1e308}]",),
        ("scenario.schedule.masses=[{every:1,growth:1},[5,2]]",),
        ("scenario.schedule.masses=[{every:3}]",),
        ("scenario.schedule.masses=[{at:1,add:1,factor:2}]",),
        ("scenario.schedule.masses=[{at:1,add:1,entry:3}]",),
        ("scenario.schedule.masses=[{at:1,add:[1,2],entry:1}]",),
        ("scenario.schedule.masses=[{at:1,value:-2}]",),
        ("scenario.schedule.masses=[[1,[2,3,4]]]",),
        ("scenario.schedule.stiffness=[[1,2]]",),
        ("scenario.schedule=3",),
        ("scenario.start.x=[1,2]",),
        ("scenario.start.q=[1]",),
        ("scenario.start.q=[nan,0]",),
        ("plant=pendulum",),
        ("plant=pendulum", "scenario=plain", "plant.masses=[1,2]"),
        ("plant=n_link_arm", "scenario=plain", "plant.n_joints=1000000000"),
        ("plant=n_link_arm", "scenario=plain", "plant.n_joints=1.5"),
        ("plant=wing_rock", "scenario=plain"),
        ("plant=null",),
        ("plant.name=foo",),
        ("plant.name=3",),
        ("reference=steps",),
        ("reference.amplitude=3",),
        ("reference=spline", "reference.path=/nowhere.csv"),
        ("reference=sum", "reference.parts=[{name:foo}]"),
        ("reference=sum", "reference.parts=3"),
        ("controller=linear_feedback",),
        ("controller.kind=foo",),
        ("controller.foo=3",),
        ("controller=linear_feedback", "controller.feedback=[[a]]"),
        ("law=gradient",),
        ("network=radial_basis", "network.basis.width=0"),
        ("network=radial_basis", "law=gradient", "law.constant.adaptation_rate=-1"),
        ("network=radial_basis", "initial.weights_file=tests/golden/initial_weights.npz"),
        ("actuator.limit=-1",),
        ("actuator=lagged", "actuator.lag=[0.1]"),
        ("actuator.limt=3",),
        ("sensor=sampled", "sensor.delay=0.015"),
        ("sensor.noise=3",),
        ("sensor=noisy", "sensor.noise.std=[1,2,3]"),
        ("sensor=noisy", "sensor.noise.seed=-1"),
        ("sensor=noisy", "sensor.noise.rate=1e12"),
        ("clock.period=0",),
        ("clock=periodic", "clock.hold=second"),
        ("model=second_order", "model.frequency=0"),
        ("model=linear",),
        ("disturbance=wind",),
        ("disturbance.input=3",),
        ("disturbance=input", "disturbance.input.amplitude=[1,2,3]"),
        ("disturbance.foo={name:sinusoid,amplitude:1}",),
        ("constants.foo=1",),
        ("constants.base_gain=[1]",),
        ("constants.base_gain=null",),
        ("constants.error_gain=[true,1]",),
        ("draws=1000000", "initial.draw=1000000"),
        ("horizon=1e7", "solver.dt=1e-6"),
        ("-m", "seed=range(0,1000000)"),
        ("-m", "controller=nn,lstm"),
        ("controler=hard",),
        ("--foo",),
        ("initial.weights_file=/nowhere.npz",),
        ("problem=rohrs", "output.animation=true"),
        ("problem=scalar_mrac", "output.animation=gif"),
        ("output.animation=avi",),
        ("output.animation=[gif]",),
    ),
    "ensemble": (
        ("spread.masses=1",),
        ("spread.masses=nan",),
        ("spread.mass=0.1",),
        ("spread=3",),
        ("first=1000000", "rollouts=1000000"),
        ("rollouts=1000000000",),
        ("chunk=10000", "memory.n_slots=100000"),
        ("plant.masses=[1e101,1]",),
        ("scenario.schedule.masses=[[1,1e200],[2,1e200]]",),
    ),
    "reproduce": (
        ("experiment=[table_9]",),
        ("horizon=nan",),
        ("horizon=inf",),
        ("solver.rtol=1e-3",),
        ("variants.nn=['controller=lstm']",),
        ("golden.srmse_file=/nowhere.json",),
        ("draws=100000",),
    ),
    "tune": (
        ("grid={rate_W:[true]}",),
        ("grid={rate_W:range(0,1000),rate_V:range(0,1000)}",),
        ("start={foo:1}",),
        ("start={rate_W:nan}",),
        ("gradient.control=[foo]",),
        ("gradient.pairs=1000000000",),
        ("gradient.pairs=0",),
        ("sensor.noise.rate=1e12",),
        ("sensor.noise.rate=0",),
        ("plant=pendulum",),
        ("plant=pendulum", "train.scenarios=[plain]"),
        ("horizon=nan",),
        ("horizon=-1",),
        ("names=[foo]",),
        ("names=[]",),
        ("train.scenarios=[foo]",),
        ("train.draws=[-1]",),
        ("held_out.draws=[1,1]",),
        ("schedule.curriculum=[[1,nan]]",),
        ("resume=/nowhere",),
        ("compare=[/nowhere]",),
    ),
    "gradient_report": (
        ("horizon=inf",),
        ("scenario.schedule.masses=[[1,1e200],[2,1e200]]",),
        ("solver=implicit", "solver.rtol=1e-3"),
        ("control=[foo]",),
        ("names=[foo]",),
        ("of_output=3",),
        ("plant=pendulum", "scenario=plain", "of_output=2"),
        ("judge=0.2",),
        ("steps=[3]",),
        ("draws=1",),
    ),
    "peers": (
        ("recall.n_pairs=9", "recall.n_keys=8"),
        ("variants=[lstm,lstm]",),
        ("variants=[foo]",),
        ("tasks=[foo]",),
        ("tasks=[]",),
        ("gap.shortest=101", "gap.longest=100"),
        ("returning.steps=30", "returning.longest=14"),
        ("returning.window=6", "returning.shortest=6"),
        ("+rates.foo=1",),
        ("rates.lstm=nan",),
        ("recall.batch=1000000", "n_slots=1000", "hidden_size=1000"),
    ),
    "ablation": (
        ("tables=[foo]",),
        ("tables=[]",),
        ("online.variants=[foo]",),
        ("online.rates=[]",),
        ("online.visit_length=1",),
        ("arm.variants=[wiped_5]",),
        ("arm.noise=[0.1]",),
        ("arm.window=20",),
        ("arm.visit_length=1e9",),
        ("recall.variants=[lstm]",),
        ("recall.seeds=0",),
    ),
    "online_regression": (
        ("rates=[]",),
        ("rates=[1,1]",),
        ("visit_length=1e12",),
        ("n_hidden=10000", "n_slots=10000", "seeds=10000"),
        ("window=20",),
    ),
    "tune_problems": (
        ("problems=[rohrs,rohrs]",),
        ("problems=[arm]",),
        ("noise=[0.1]",),
        ("held_out=10000", "train=1000", "workers=64"),
    ),
    "export": (
        ("export.period=0",),
        ("export.period=nan",),
        ("export.period=1e-3", "clock.period=0.01"),
        ("clock=periodic", "clock.hold=first"),
        ("export.dtype=float16",),
        ("export.dtype=float32", "problem=wing_rock_concurrent"),
        ("export.constants=frozen",),
        ("export.name=3d",),
        ("export.name=while",),
        ("export.name=''",),
        ("export.name=a/b",),
        ("export.runtimes=[]",),
        ("export.runtimes=[c,c]",),
        ("export.runtimes=[fortran]",),
        ("export.runtimes=c",),
        ("export.tuned=/nowhere",),
        ("export.learned=maybe",),
        ("export.foo=1",),
        ("output.figures=true",),
        ("plant=pendulum",),
        ("controller=linear_feedback",),
    ),
    "returning": (
        ("variants=[plain,nobody]",),
        ("spread=[1]",),
        ("noise=[0.1]",),
        ("window=20",),
        ("shared=['problem=scalar_mrac']",),
        ("ways.plain.overrides=['foo=1']",),
        ("ways.plain.tuned=[foo]",),
        ("visit_length=1e12",),
    ),
}


def invalid(count: int, seed: int) -> Iterator[tuple[str, list[str]]]:
    """`count` command lines, each a command and arguments that it has to refuse."""
    chance = random.Random(seed)
    chosen = {command: [(), *(LOOPS if command in OF_LOOPS else ())] for command in COMMANDS}
    leaves = {
        (command, how): list(_leaves(compose_job(command, [*how])))
        for command in COMMANDS
        for how in chosen[command]
    }
    for _ in range(count):
        (command,) = chance.choices(COMMANDS, SHARE)
        if chance.random() < 0.25:
            yield command, list(chance.choice(TOGETHER[command]))
            continue
        how = chance.choice(chosen[command])
        name, value = chance.choice(leaves[command, how])
        yield command, [*how, f"{name}={chance.choice(_spoiled(name, value))}"]


def too_large(command: str) -> Iterator[list[str]]:
    """Every size and count of a command, as large as can be typed."""
    for name, _ in _leaves(compose_job(command, [])):
        if name in _SIZES:
            yield [f"{name}=1000000000000"]
            yield [f"{name}=9000000000000000000"]


def _leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by dotted name: numbers, names, and lists of numbers."""
    if prefix.startswith(("run_dir", "tables.", "figures.", "variants.", "grid.", "golden.")):
        return
    if isinstance(node, DictConfig) and not node._is_none():
        for key in node:
            yield from _leaves(node._get_node(key), f"{prefix}{key}.")
        return
    value = OmegaConf.to_container(node) if isinstance(node, ListConfig) else node._value()
    of_numbers = isinstance(value, list) and value and not isinstance(value[0], str | list)
    if of_numbers or isinstance(value, bool | int | float):
        yield prefix.removesuffix("."), value


def _spoiled(name: str, value: Any) -> list[str]:
    """What could stand after `name=` and can't be used."""
    own = name.rpartition(".")[2]
    if isinstance(value, bool):
        return ["maybe", "[true]", "nan", "2.5"]
    if isinstance(value, list):
        bad = ["[nan,1]", "[1,inf]", "[true,1]", "[a,b]", "foo", "{a:1}"]
        return bad if own in _ANY_SIGN else [*bad, "[-1,1]"]
    bad = ["nan", "inf", "-inf", "true", "foo", "[1,2,3,4,5]", "{a:1}", "1e", "''"]
    if own not in _ANY_SIGN:
        bad.append("-1")
    if name in _SIZES:
        bad += ["0", "1000000000", "1000000000000"]
    if isinstance(value, int):
        bad += ["2.5", "99999999999999999999"]
    return bad
