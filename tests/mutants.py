"""Would the tests notice? Small faults in the scientific core, one at a time, in a copy of it.

python -m tests.mutants [--only rewards]

Each line is a file, what it says, what the fault says instead. Survivors are printed; whoever adds
to the core adds a fault here, and whoever finds one that survives a test.
"""

# ruff: noqa: E501

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
TESTS = {
    "rl/rewards": "rl/test_rewards rl/test_incentives test_laws",
    "rl/observer": "rl/test_observer rl/test_rewards",
    "rl/timing": "rl/test_timing",
    "rl/feedback": "rl/test_feedback",
    "rl/evaluation": "rl/test_evaluation",
    "task/path": "task/test_path test_laws",
    "report/statistics": "report/test_statistics test_laws",
    "report/evaluations": "report/test_evaluations",
    "eeg/splits": "eeg/test_splits",
    "eeg/scores": "eeg/test_scores test_laws",
    "eeg/lda": "eeg/test_lda",
}
MUTANTS = """
rl/rewards | PLACED = 1.0 | PLACED = 0.5
rl/rewards | COLLISION = -2.0 | COLLISION = -1.0
rl/rewards | PROGRESS = 25.0 | PROGRESS = 20.0
rl/rewards | max(0.0, moment.best - moment.remaining) | max(0.0, moment.gained)
rl/rewards | max(0.0, moment.best - moment.remaining) | moment.best - moment.remaining
rl/rewards | return 1.0 - p_error | return 0.5 - p_error
rl/rewards | over = moment.success or moment.lost | over = moment.success
rl/rewards | and not moment.success: | and True:
rl/rewards | self.w_hf * float(self._discounts @ feedback if over | 1.0 * float(self._discounts @ feedback if over
rl/rewards | np.exp(-moment.deviation / NEAR_PATH) | np.exp(-moment.deviation)
rl/rewards | EVALUATED_COLLISION * moment.collided | 0.0 * moment.collided
rl/observer | SURE_PROGRESS = 0.015 | SURE_PROGRESS = 0.03
rl/observer | UNEASY_CLEARANCE = 0.02 | UNEASY_CLEARANCE = 0.0
rl/observer | return 1.0 - progress(moment) * comfort(moment.clearance) | return 1.0 - progress(moment)
rl/observer | if moment.lost or moment.collided: | if moment.lost:
rl/observer | self._rng.random() < self.looks_wrong | self._rng.random() > self.looks_wrong
rl/observer | now[wrong][[ | now[0][[
rl/timing | return [(now if credit == "arrival" else event, interval)] | return [(now, interval)]
rl/timing | range(max(event - interval + 1, first), last + 1) | range(event - interval + 1, last + 1)
rl/timing | share * (answer - self._paid[step]) | share * answer
rl/feedback | rows["p_error"].mean() | rows["p_error"].median()
rl/feedback | evidence + logit(prior)) | evidence)
rl/evaluation | PLACED * (env.horizon - metrics["steps"]) * metrics["success"] | PLACED * metrics["success"]
task/path | CARRY_DETOUR, REACH_DETOUR = 2.5, 1.5 | CARRY_DETOUR, REACH_DETOUR = 1.01, 1.5
task/path | slope = 1 / np.sqrt(detour**2 - 1) | slope = 0.0
task/path | max(self.carry_length, carry) | carry
task/path | min(1.0, completed * ideal / executed) | min(1.0, ideal / executed)
task/path | min(self._reach.distance(hand), self._carry.distance(hand)) | self._carry.distance(hand)
task/path | GRASP_WORTH * (1 + 0.5 * state.squeeze * (1 - 2 * near)) | GRASP_WORTH
report/statistics | trim_mean(values, 0.25, | trim_mean(values, 0.1,
report/statistics | np.sqrt(n / (n - 1)) * | 1.0 *
report/statistics | MIN_UNITS = 5 | MIN_UNITS = 3
report/statistics | np.nanmean((1 + np.sign(a - b)) / 2, | np.mean((1 + np.sign(a - b)) / 2,
report/statistics | (1 + np.sign(a - b)) / 2 | 1.0 * (a > b)
report/statistics | np.arange(n, n - len(p), -1) | n
report/statistics | low = permutation_test(first + margin, | low = permutation_test(first - margin,
report/statistics | return float(p if paired else max(p, welch(*samples).pvalue)), smallest | return float(p), smallest
report/statistics | smallest = _smallest(2**n if paired else comb(n + m, n), sides) | smallest = 0.0
report/evaluations | np.ceil(3 * runs["step"] / runs["step"].max()) | np.floor(3 * runs["step"] / runs["step"].max())
report/evaluations | == phase | <= phase
eeg/splits | pool = subjects[position + 1 :] + subjects[:position] | pool = subjects[position:] + subjects[:position]
eeg/splits | if s not in self.validation[network] | if True
eeg/splits | pool[(network * size + i) % len(pool)] | pool[i % len(pool)]
eeg/scores | n_errors * (n_errors + 1) / 2 | n_errors * n_errors / 2
eeg/scores | count[filled] * np.abs | np.abs
eeg/scores | said = p_error > prior | said = p_error > 0.5
eeg/scores | (1 + exceeding) / (1 + n_resamples) | exceeding / n_resamples
eeg/lda | return (1 - share) * covariance + share * np.diag(variance) | return covariance + 1e-9 * np.diag(variance)
eeg/lda | weights @ (error + correct)[:size] / 2 | weights @ error[:size]
"""


def mutants(only="") -> list[tuple[str, str, str]]:
    """Module, text and fault of every line, of the modules whose name holds a word."""
    lines = (line.split(" | ") for line in MUTANTS.strip().splitlines())
    return [(module, old, new) for module, old, new in lines if only in module]


def passes(module, old="", new="") -> bool:
    """Whether the tests of a module pass, with a fault in it if one is given."""
    with tempfile.TemporaryDirectory(prefix="rlihf-mutant-") as place:
        for name in ("rlihf_lib", "tests", "results/paper-simulated/decoder"):
            shutil.copytree(REPOSITORY / name, Path(place) / name)
        shutil.copy(REPOSITORY / "pyproject.toml", place)
        file = Path(place) / "rlihf_lib" / f"{module}.py"
        source = file.read_text(encoding="utf-8")
        if old and source.count(old) != 1:
            raise ValueError(f"{module}: {old!r} is there {source.count(old)} times; mend the line")
        file.write_text(source.replace(old, new) if old else source, encoding="utf-8")
        tests = [f"tests/{name}.py" for name in TESTS[module].split()]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
        environment = {**os.environ, "PYTHONPATH": place}
        done = subprocess.run([*command, *tests], cwd=place, env=environment, capture_output=True)
        return done.returncode == 0


def main() -> None:
    """Try all faults and say which survive."""
    command = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    command.add_argument("--only", default="", metavar="WORD")
    tried = mutants(command.parse_args().only)
    for module in dict.fromkeys(module for module, *_ in tried):
        if not passes(module):
            sys.exit(f"the tests of {module} fail without a fault: {TESTS[module]}")
    survivors = 0
    for mutant in tried:
        if passes(*mutant):
            survivors += 1
            print("survives:", *mutant, sep=" | ", flush=True)
    print(f"{len(tried) - survivors} of {len(tried)} faults are noticed")


if __name__ == "__main__":
    main()
