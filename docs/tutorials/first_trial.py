"""From gymnasium.make to a scored trial: python docs/tutorials/first_trial.py [SCENE]."""

import sys

import gymnasium

from trials.gym.env.policies import NavigatorPolicy

env = gymnasium.make(
    "driftyard:driftyard/RoverNav-v0",  # of the module that registers it
    scene=sys.argv[1] if len(sys.argv) > 1 else "office",
    localization="vo",  # or "truth", "wheels", "module:Class"
    observe=NavigatorPolicy.NEEDS,  # disparity, estimated pose, goal
)
observation, info = env.reset(seed=10)
policy = NavigatorPolicy(env.unwrapped)
while not info["outcome"]:
    observation, reward, terminated, truncated, info = env.step(policy.act(observation))
print(f"{info['outcome']} after {info['time_s']:.1f} s and {info['driven_m']:.2f} m")
print(f"SPL {info['spl']:.2f}, localized to {1000 * info['error_m']:.1f} mm")
env.close()
