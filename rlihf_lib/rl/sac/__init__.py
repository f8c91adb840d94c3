"""Soft Actor-Critic: Stable-Baselines3's, with other critics and a faster update.

**Usage.** `model = make_sac(env, SACSettings(), seed=0)`, then `model.learn(150_000)`: in every
other respect it is a `stable_baselines3.SAC`; `predict`, callbacks, `save` and `load` are SB3's.

**An update** (Haarnoja et al. 2018, arXiv 1812.05905; `learner`). Of a batch of n-step transitions
(s, a, R, g, s'), where R sums n discounted rewards and g is discount^n, or 0 behind a terminal
state, with policy pi, critics Q1 and Q2, their targets T1 and T2, and temperature alpha:

- y = R + g (min(T1, T2)(s', a') - alpha log pi(a'|s')), with a' drawn from pi(s');
- critics: a step of Adam down 1/2 sum_i mean (Q_i(s, a) - y)^2;
- policy: down mean (alpha log pi(a|s) - min(Q1, Q2)(s, a)), with a drawn from pi(s);
- temperature: log alpha falls while the policy's entropy is above its target, else it rises;
- targets: T_i moves the share tau of the way to Q_i.

**What differs from SB3's SAC**, and the test in `tests/rl/test_sac.py` that holds it:

- The critics' hidden layers are normalised, which keeps values from running away under noisy
  rewards (Ball et al. 2023, RLPD); they are stacked, one product a layer for both (`networks`).
  `test_update_equals_that_of_stable_baselines3`: SB3's own update, of these networks.
- Critics are fitted at s and a with a little Gaussian noise, which smooths them (Bishop 1995):
  otherwise they learn the noise of single epochs by heart (`batch`; notebook 03).
  `test_critics_are_fitted_to_noisy_inputs_and_asked_about_clean_ones`.
- The same arithmetic is written out, without autograd and other bookkeeping (`passes`, `kernels`,
  `adam`): more than half of the time goes there for networks this small.
  `test_update_equals_that_of_stable_baselines3`, up to rounding.
- Actions are drawn without building a distribution, which SB3 validates every step (`networks`).
  `test_actions_equal_those_of_stable_baselines3`, bit by bit.
- n-step batches are copied by one compiled loop (`batch`).
  `test_batch_holds_what_stable_baselines3_samples`.

**What is logged** every `log_every` steps, of the update then made: critic_loss, the first sum
above as in SB3; ent_coef, alpha; mean_q, the mean of Q1 and Q2. A run's train.csv holds them,
notebook 03 draws them.
"""

from rlihf_lib.rl.sac.learner import FastSAC, make_sac

__all__ = ["FastSAC", "make_sac"]
