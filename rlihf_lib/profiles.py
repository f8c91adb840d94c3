"""Sizes of a study: how many people, seeds and steps."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DecoderSizes:
    """How long and how often the decoder is trained; never how it works."""

    max_epochs: int
    """Passes over the training subjects at most."""
    patience: int
    """Passes without a better validation loss after which training stops."""
    ensemble: int
    """Networks per fold, with different seeds, whose outputs are averaged."""
    n_permutations: int
    """Label permutations behind the chance level."""


@dataclass(frozen=True)
class Profile:
    """Sizes of a study. A profile changes sizes, never code paths."""

    name: str
    n_subjects: int | None
    """Subjects decoded, the first of the source; None = all of them."""
    n_policy_subjects: int | None
    """Subjects whose decoded feedback trains policies; None = every decoded one."""
    n_ablation_subjects: int | None
    """Of the policy subjects, how many also get the other weights; None = all."""
    seeds: tuple[int, ...]
    """One run per seed, condition, weight and policy subject (paper: five)."""
    total_steps: int
    """Environment steps of training (paper: 150,000)."""
    eval_every: int
    """Training steps between two evaluation points."""
    decoder: DecoderSizes = DecoderSizes(30, patience=8, ensemble=6, n_permutations=1_000)
    horizon: int = 1000
    """Steps after which an episode is truncated (paper: 1000)."""
    eval_rollouts: int = 5
    """Rollouts per evaluation point (paper: 5)."""
    rank: float = 0.5
    """Whose feedback trains policies where one person's does: 0 the weakest decoder's, 1 the
    strongest's."""
    ablation_seeds: tuple[int, ...] = (0,)
    """Of the seeds, those of the ablation."""
    tuned_seeds: tuple[int, ...] = (0,)
    """Of sparse reward with settings of its own."""
    ideal_seeds: tuple[int, ...] = (0,)
    """Of the seeds, those of an ideal decoder."""
    control_seeds: tuple[int, ...] = (0,)
    """Of the seeds, those of feedback that says nothing."""
    tuned_discounts: tuple[float, ...] = (0.98,)
    """Discounts of sparse reward with settings of its own: the better of the pilots' two."""
    weights: tuple[float, ...] = (0.1, 0.4, 0.7)
    """Weights of human feedback compared in Fig. 6 (paper: these three)."""
    w_hf: float = 0.7
    """Weight of the main comparison (Fig. 4, Table I): the best of the paper's three."""
    experiments: tuple[str, ...] = ()
    """Of `experiments.EXPERIMENTS` (notebook 06), those that are made."""

    def n_runs(self, stage, n_people) -> int:
        """Count the runs of a stage of `Study.run_configs` that waits for `n_people` decoders."""
        main, ablation = (
            min(wanted or n_people, n_people)
            for wanted in (self.n_policy_subjects, self.n_ablation_subjects)
        )
        return {
            "rlihf": main * len(self.seeds),
            "controls": len(self.ideal_seeds) + 2 * len(self.control_seeds),
            "ablation": ablation * len(self.weights) * len(self.ablation_seeds),
        }[stage]


PROFILES = {
    profile.name: profile
    for profile in (
        Profile(
            name="smoke",
            n_subjects=3,
            n_policy_subjects=1,
            n_ablation_subjects=1,
            seeds=(0,),
            total_steps=3_000,
            eval_every=1_000,
            decoder=DecoderSizes(max_epochs=15, patience=5, ensemble=2, n_permutations=100),
            horizon=60,
            eval_rollouts=2,
            experiments=("observers",),
        ),
        # A lesson's: from nothing in ten minutes on two cores, and something is learnt. By the
        # strongest decoder's feedback, for others need more steps.
        Profile(
            name="class",
            n_subjects=6,
            n_policy_subjects=1,
            n_ablation_subjects=1,
            rank=1.0,
            seeds=(0,),
            tuned_seeds=(),
            ideal_seeds=(),
            control_seeds=(),
            weights=(0.1, 0.7),
            total_steps=27_500,
            eval_every=2_500,
            decoder=DecoderSizes(max_epochs=30, patience=8, ensemble=3, n_permutations=100),
            horizon=100,
        ),
        Profile(
            name="quick",
            n_subjects=12,
            n_policy_subjects=8,
            n_ablation_subjects=1,
            seeds=(0, 1),
            ablation_seeds=(0, 1),
            tuned_seeds=(),
            ideal_seeds=(),
            control_seeds=(),
            total_steps=60_000,
            eval_every=5_000,
        ),
        Profile(
            name="paper",
            n_subjects=None,
            n_policy_subjects=None,
            n_ablation_subjects=None,
            seeds=(0, 1, 2, 3, 4),
            ablation_seeds=(0, 1),
            tuned_seeds=(0, 1, 2, 3, 4),
            ideal_seeds=(0, 1, 2, 3, 4),
            control_seeds=(0, 1, 2),
            total_steps=150_000,
            eval_every=10_000,
        ),
        # The final settings at the paper's length on seeds that no study uses.
        Profile(
            name="pilots",
            n_subjects=None,
            n_policy_subjects=3,
            n_ablation_subjects=1,
            seeds=(100, 101),
            ablation_seeds=(100,),
            tuned_seeds=(100, 101),
            ideal_seeds=(100, 101),
            control_seeds=(),
            tuned_discounts=(0.98, 0.99),
            weights=(0.7,),
            total_steps=150_000,
            eval_every=10_000,
        ),
    )
}
