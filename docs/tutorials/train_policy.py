"""Train a policy with Stable-Baselines3: python docs/tutorials/train_policy.py FOLDER.

`train_policy.md` explains it. Needs `pip install "driftyard[rl]"`.
"""

import argparse
import csv
from pathlib import Path

import gymnasium
import numpy as np

import driftyard as dy
from trials.gym.studies.trial_results import Result, summarize
from trials.report.figure import GREEN, GREY, INK, RED, save_figure, tidy
from trials.report.tables import markdown_table

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import CheckpointCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize
except ModuleNotFoundError as error:
    raise SystemExit(f'{error.name} is missing: pip install "driftyard[rl]"') from None

NAV = "driftyard:driftyard/RoverNav-v0"
PEN = """<mujoco>
<visual><headlight active="0"/></visual>
<default>
 <default class="wall"><geom type="box" size="3.1 .05 .3" material="wall"/></default>
 <default class="pillar"><geom type="cylinder" size=".22 .4" material="pillar"/></default>
</default>
<asset>
 <texture name="ground" type="2d" builtin="flat" width="512" height="512" mark="random"
  random=".2" rgb1=".62 .62 .58" markrgb=".45 .45 .42"/>
 <texture name="wall" type="2d" builtin="flat" width="512" height="128" mark="random"
  random=".2" rgb1=".85 .85 .85" markrgb=".6 .6 .6"/>
 <texture name="pillar" type="2d" builtin="flat" width="256" height="256" mark="random"
  random=".2" rgb1=".15 .15 .2" markrgb=".4 .4 .4"/>
 <material name="ground" texture="ground" texuniform="true" texrepeat=".5 .5" specular="0"/>
 <material name="wall" texture="wall" specular="0"/>
 <material name="pillar" texture="pillar" specular="0"/>
</asset>
<worldbody>
 <light type="directional" dir=".3 .2 -1" ambient=".4 .4 .4"/>
 <geom name="ground" type="plane" size="3.1 3.1 1" material="ground"/>
 <geom name="north" class="wall" pos="0 3.05 .3"/>
 <geom name="south" class="wall" pos="0 -3.05 .3"/>
 <geom name="east" class="wall" pos="3.05 0 .3" euler="0 0 90"/>
 <geom name="west" class="wall" pos="-3.05 0 .3" euler="0 0 90"/>
 {pillars}
</worldbody></mujoco>"""
"""6 x 6 m between walls."""
PILLARS, APART_M, INSIDE_M = 5, 1.4, 2.3
STEPS, BINS, NEW_PENS = 98_304, 24, 1000
"""Steps of the training, 48 rollouts of 2048; points of its curve; first seed of other pens."""
OUTCOMES = ("success", "collision", "timeout")
FREE = np.array([0.0, -1.0])
"""Where the default route of an MJCF file begins, which must be free."""


def write_pen(folder: Path, seed: int) -> Path:
    """Write a pen with pillars at places that the seed decides."""
    rng, places = np.random.default_rng(seed), [FREE]
    while len(places) <= PILLARS:
        place = rng.uniform(-INSIDE_M, INSIDE_M, 2)
        if all(np.linalg.norm(place - other) > APART_M for other in places):
            places.append(place)
    pillars = "\n ".join(
        f'<geom name="pillar_{k}" class="pillar" pos="{x:.3f} {y:.3f} .4"/>'
        for k, (x, y) in enumerate(places[1:])
    )
    file = folder / f"pen_{seed}.xml"
    file.write_text(PEN.format(pillars=pillars))
    return file


def make_env(pen: Path, **options):
    """Make the environment of the policy: a small grey image, and the goal by wheel odometry."""
    return gymnasium.make(
        NAV,
        **{
            "scene": str(pen),
            "camera": "ideal",
            "settings": {"rig.width_px": 64, "rig.height_px": 48},
            "observe": ("left", "goal"),
            "localization": "wheels",
            "rate_hz": 5.0,
            "distance_m": (1.5, 4.0),
            "time_limit_s": 30.0,
            **options,
        },
    )


def train(folder: Path, steps: int, pens: int, seed: int) -> None:
    """Train; writes policy.zip, and a line for every trial into training.monitor.csv."""
    torch.set_num_threads(1)  # the network is small
    files = [write_pen(folder, k) for k in range(pens)]
    envs = DummyVecEnv([lambda file=file: make_env(file) for file in files])
    envs = VecMonitor(envs, str(folder / "training"), info_keywords=("outcome", "success"))
    model = PPO(
        "MultiInputPolicy",
        VecNormalize(envs, norm_obs=False),  # of the rewards
        n_steps=max(2, min(steps, 2048) // pens),
        batch_size=256,
        n_epochs=5,
        policy_kwargs={
            "log_std_init": -0.7,
            "features_extractor_kwargs": {"cnn_output_dim": 64},
        },
        seed=seed,
        device="cpu",
    )
    checkpoints = CheckpointCallback(max(1, 20_000 // pens), str(folder), "policy")
    model.learn(steps, callback=checkpoints)
    model.save(folder / "policy")


def learning_curve(folder: Path, steps: int) -> None:
    """Write learning_curve.csv and .png from the trials of the training."""
    with (folder / "training.monitor.csv").open() as file:
        next(file)  # a comment
        trials = list(csv.DictReader(file))
    ends = np.cumsum([int(trial["l"]) for trial in trials])
    rows, size = [], max(1, steps // BINS)
    for k in range(0, steps - size + 1, size):
        some = [trials[i] for i in np.flatnonzero((ends > k) & (ends <= k + size))]
        if some:
            returns = [float(trial["r"]) for trial in some]
            shares = [np.mean([x["outcome"] == word for x in some]) for word in OUTCOMES]
            rows.append((k + size, len(some), np.mean(returns), *shares))
    with (folder / "learning_curve.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("steps", "trials", "return", *OUTCOMES))
        writer.writerows([[f"{x:.4g}" if x % 1 else int(x) for x in row] for row in rows])
    save_figure(folder / "learning_curve.png", (8.0, 3.0), lambda figure: draw(figure, rows))


def draw(figure, rows) -> None:
    """Draw mean return and outcomes over the steps of the training."""
    steps, _, returns, *shares = np.transpose(np.reshape(rows, (-1, 3 + len(OUTCOMES))))
    left, right = figure.subplots(1, 2)
    left.plot(steps / 1000, returns, color=INK)
    tidy(left, "thousand steps", "mean return of a trial")
    for word, share, colour in zip(OUTCOMES, shares, (GREEN, RED, GREY), strict=True):
        right.plot(steps / 1000, share, color=colour, label=word)
    tidy(right, "thousand steps", "share of trials")
    right.legend()


def drivers(model: PPO):
    """Name to the environment of a driver in a pen, and to the driver of a trial in it."""
    tall = {"settings": {"rig.width_px": 320, "rig.height_px": 240}, "rate_hz": 10.0}
    return {
        "trained": (make_env, lambda env: lambda seen: model.predict(seen, deterministic=True)[0]),
        "navigator": (
            lambda pen: make_env(pen, observe=dy.NavigatorPolicy.NEEDS, **tall),
            lambda env: dy.NavigatorPolicy(env.unwrapped).act,
        ),
        "goal alone": (make_env, lambda env: straight),
    }


def straight(seen) -> np.ndarray:
    """Turn to the goal, and drive when it is ahead: the image is not looked at."""
    angle = np.arctan2(seen["goal"][1], seen["goal"][0])
    return np.array([max(0.0, np.cos(angle)), np.clip(2 * angle, -1, 1)], np.float32)


def evaluate(folder: Path, model: PPO, pens: int, runs: int) -> None:
    """Drive the same trials, in pens that the policy never saw, and print a table."""
    results = {}
    for name, (make, driver_of) in drivers(model).items():
        results[name] = []
        for layout in range(NEW_PENS, NEW_PENS + pens):
            env = make(write_pen(folder, layout))
            for run in range(runs):
                seen, info = env.reset(seed=run)
                act = driver_of(env)
                while not info["outcome"]:
                    seen, _, _, _, info = env.step(act(seen))
                found = {key: info[key] for key in ("outcome", "time_s", "driven_m", "way_m")}
                results[name].append(Result(layout, run, env.unwrapped.trial.localization, **found))
            env.close()
    with (folder / "evaluation.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("driver", "pen", "run", "outcome", "time_s", "driven_m", "way_m"))
        for name, of_driver in results.items():
            for x in of_driver:
                numbers = (f"{v:.3f}" for v in (x.time_s, x.driven_m, x.way_m))
                writer.writerow((name, x.layout, x.run, x.outcome, *numbers))
    metrics = {
        "SPL": (lambda x: x.success * x.way_m / max(x.way_m, x.driven_m), 2),
        "time s": (lambda x: x.time_s, 1),
    }
    columns = {name: summarize(found, metrics) for name, found in results.items()}
    rows = [(row, *(x[row] for x in columns.values())) for row in next(iter(columns.values()))]
    print(markdown_table((f"{pens} pens x {runs}", *columns), rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Train a policy, and evaluate it.")
    parser.add_argument("folder", type=Path, help="of the results")
    parser.add_argument("--steps", type=int, default=STEPS, help="of the training; 0: evaluate")
    parser.add_argument("--pens", type=int, default=16, help="worlds of the training")
    parser.add_argument("--new-pens", type=int, default=10, help="worlds of the evaluation")
    parser.add_argument("--runs", type=int, default=5, help="trials in each of these")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    if args.steps:
        train(args.folder, args.steps, args.pens, args.seed)
        learning_curve(args.folder, args.steps)
    evaluate(args.folder, PPO.load(args.folder / "policy", device="cpu"), args.new_pens, args.runs)
