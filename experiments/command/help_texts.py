"""What `--help` says, command by command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..settings.ablation_config import TABLES as ABLATIONS
from ..settings.benchmarks_config import BENCHMARKS
from ..settings.export_config import RUNTIMES
from ..settings.memory_config import LEARNERS
from ..settings.peers_config import PEERS, TASKS
from ..settings.problem_tuning_config import TUNED_PROBLEMS
from .conf_files import group_names
from .started import as_started


@dataclass(frozen=True)
class Help:
    """A purpose, the groups of `conf` with their names, other choices, and examples."""

    purpose: str
    examples: dict[str, str]
    groups: tuple[str, ...] = ()
    choices: Callable[[], dict[str, tuple[str, ...]]] = field(default=dict)


#: What a loop and what is asked of it are chosen from.
LOOP = (
    *("scenario", "plant", "reference", "controller", "network", "law", "keys", "actuator"),
    *("sensor", "clock", "model", "disturbance", "solver", "problem"),
)
HELP = {
    "simulate": Help(
        "Simulate one scenario under one controller: SRMSE, figures, TensorBoard, arrays.",
        {
            "example": "scenario=5 controller=soft draws=3",
            "sweep": "-m scenario=1,4 controller=nn,soft",
            "plant": "plant=pendulum scenario=plain reference=minimum_jerk controller=hard",
            "payload": "scenario.schedule.masses=[[10,[1,1.2]]]",
        },
        LOOP,
    ),
    "ensemble": Help(
        "Roll one scenario out thousands of times, with random parameters and draws: how SRMSE "
        "is spread, and which rollouts are the worst.",
        {
            "example": "scenario=1 controller=hard rollouts=10000 spread.masses=0.3",
            "spread out": "-m first=0,2500,5000,7500 rollouts=2500 hydra/launcher=joblib",
        },
        LOOP,
    ),
    "export": Help(
        "Write a loop's controller as a step at a fixed rate: C code, or for another runtime.",
        {
            "example": "export.period=1e-3 export.name=arm",
            "tuned": "export.tuned=logs/tune/STAMP export.constants=struct",
            "small": "controller=nn export.dtype=float32 export.libm=false",
            "learned": "scenario=illustration export.learned=true",
            "problem": "problem=limited_input export.runtimes=[c,onnx]",
        },
        LOOP,
        lambda: {"runtimes": RUNTIMES},
    ),
    "reproduce": Help(
        "Reproduce the paper's tables, figures and claims.",
        {
            "one table": "experiment=[table_1]",
            "quick": "draws=1 horizon=10",
        },
        ("experiment", "solver"),
    ),
    "tune": Help(
        "Tune design constants by gradient, then judge them on scenarios and draws held out.",
        {
            "fewer": "names=[write_gain,error_gain]",
            "plant": "plant=pendulum train.scenarios=[plain] held_out.scenarios=[plain]",
            "resume": "resume=logs/tune/STAMP",
            "compare": "compare=[logs/tune/OTHER]",
        },
        LOOP,
    ),
    "gradient_report": Help(
        "Every gradient mode against differences, constant by constant, for one scenario.",
        {
            "example": "scenario=4 controller=hard",
            "plant": "plant=pendulum scenario=plain controller=hard",
        },
        LOOP,
    ),
    "online_regression": Help(
        "Learn a function that changes abruptly and comes back, sample by sample: the network "
        "alone and with a memory.",
        {
            "fewer": "variants=[network,soft]",
            "a member": "member=3",
            "sweep": "-m write_gain=0.5,1",
        },
        choices=lambda: {"variants": LEARNERS},
    ),
    "peers": Help(
        "Train sequence models of equal size by backpropagation: the memory beside LSTM, GRU, "
        "attention and titans, on recall, copy, a long gap and returning changes.",
        {
            "fewer": "tasks=[recall] variants=[lstm,memory] seeds=2",
            "harder": "recall.n_keys=12 recall.n_pairs=10 n_slots=12",
            "longer": "tasks=[copy] copy.iterations=3000 rates.lstm=0.01",
        },
        choices=lambda: {"tasks": TASKS, "variants": PEERS},
    ),
    "ablation": Help(
        "What each part of the memory is worth, where it pays: online regression, an arm whose "
        "payloads return, recall by backpropagation; a table each.",
        {
            "one table": "tables=[arm]",
            "fewer": "tables=[online] online.variants=[plain,readouts_5]",
            "faster law": "tables=[arm] arm.rate=100",
        },
        choices=lambda: {"tables": ABLATIONS},
    ),
    "benchmarks": Help(
        "Problems with known answers: published or closed form beside ours, a verdict for every "
        "number, a picture each.",
        {
            "fewer": "problems=[rohrs,l1]",
            "engine": "problems=[estimators] engine=torch halved=false",
            "wrong": "problems=[scalar_mrac] 'overrides=[\"law.constant.adaptation_rate=0.3\"]'",
        },
        choices=lambda: {"problems": BENCHMARKS},
    ),
    "tune_problems": Help(
        "Tune benchmark problems by gradient through the loop, and judge them on other members, "
        "beside published constants.",
        {"one": "problems=[rohrs]", "more": "train=32 iterations=200", "less": "effort_limit=0.9"},
        choices=lambda: {"problems": TUNED_PROBLEMS},
    ),
    "returning": Help(
        "Regimes of wing rock that return: plain law, concurrent learning and the paper's memory.",
        {
            "fewer": "variants=[plain,memory_5]",
            "one more": "'+ways.mine={overrides:[\"law.sigma.sigma=0.1\"]}' variants=[mine]",
            "longer": "visits=8 visit_length=20",
        },
    ),
}


def help_text(command: str) -> str:
    """Hydra's help template for a command."""
    said = HELP[command]
    names = {group: group_names(group) for group in said.groups} | said.choices()
    lines = [f"  {name:<12}{', '.join(offered)}" for name, offered in names.items()]
    started = " ".join(as_started(command))
    examples = [f"  {what:<12}{started} {arguments}" for what, arguments in said.examples.items()]
    settings = ["Settings, each as NAME=VALUE:", "", "$CONFIG"]
    return "\n".join([said.purpose, "", *lines, "", *examples, "", *settings])
