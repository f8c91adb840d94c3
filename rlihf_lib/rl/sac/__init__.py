"""Soft Actor-Critic: Stable-Baselines3's, with other critics and a faster update.

**Usage.** `model = make_sac(env, SACSettings(), seed=0)`, then `model.learn(150_000)`: in every
other respect it is a `stable_baselines3.SAC`; `predict`, callbacks, `save` and `load` are SB3's.
Every setting stands with a sentence in `rl/runs.py`, `SACSettings`.

**An update** (Haarnoja et al. 2018, arXiv 1812.05905; `learner`). Of a batch of n-step transitions
(s, a, R, g, s'), where R sums n discounted rewards and g is discount^n, or 0 behind a terminal
state, with policy pi, critics Q1 and Q2, their targets T1 and T2, and temperature alpha. Equation
by equation, what SB3's SAC does, what is done here, and the test in `tests/rl/test_sac.py` that
holds it:

1. Batch. SB3 copies the transitions by NumPy's indexing; here one compiled loop does (`batch`), to
   the same numbers: `test_batch_holds_what_stable_baselines3_samples`.
2. Target, y = R + g (min(T1, T2)(s', a') - alpha log pi(a'|s')), with a' drawn from pi(s'). As SB3.
3. Critics, a step of Adam down 1/2 sum_i mean (Q_i(s, a) - y)^2. Two differences.
   Q_i: every hidden layer is relu(layer_norm(W x + b)), where SB3's is relu(W x + b), which keeps
   values from running away under noisy rewards (Ball et al. 2023, RLPD); both critics are stacked,
   one product a layer (`networks`). `test_update_equals_that_of_stable_baselines3` compares with
   SB3's own update of such networks.
   s, a: a little Gaussian noise is added to both, here only, which smooths the critics (Bishop
   1995): otherwise they learn the noise of single epochs by heart (notebook 03).
   `test_critics_are_fitted_to_noisy_inputs_and_asked_about_clean_ones`.
4. Policy, down mean (alpha log pi(a|s) - min(Q1, Q2)(s, a)), with a drawn from pi(s). As SB3.
5. Temperature, down -log alpha (mean log pi(a|s) + target entropy). As SB3.
6. Targets, T_i moves the share tau of the way to Q_i. As SB3.
7. Gradients of 3 to 5. SB3 asks autograd; here the same arithmetic is written out (`passes`,
   `learner`), as more than half of the time goes into bookkeeping for networks this small.
   Up to rounding the same: `test_update_equals_that_of_stable_baselines3`,
   `test_batch_size_may_change`, `test_saved_learner_goes_on_as_it_would_have`.
8. Acting, a = tanh(mean + deviation * noise). SB3 builds a distribution, and validates it, every
   step; here it is drawn at once (`networks`), to the same bits:
   `test_actions_equal_those_of_stable_baselines3`.

**What is logged** every `log_every` steps, of the update then made: critic_loss, the sum in 3;
ent_coef, alpha; mean_q, the mean of Q1 and Q2. A run's train.csv holds them, notebook 03 draws
them.
"""

from rlihf_lib.rl.sac.learner import FastSAC, make_sac

__all__ = ["FastSAC", "make_sac"]
