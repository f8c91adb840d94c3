"""What determines a run: its config, its readable id, its hash."""

import dataclasses
from dataclasses import dataclass, field

from rlihf_lib.files import canonical_json, sha256

CONDITIONS = ("sparse", "dense", "rlihf")
# Raised by whoever changes task, observer, rewards or learner so that results change: runs of an
# earlier protocol then count as missing.
PROTOCOL = 5


@dataclass(frozen=True)
class SACSettings:
    """Hyper-parameters of every run, the same for all conditions."""

    hidden: tuple[int, int] = (128, 128)
    """Units of the two hidden layers of actor and critics."""
    learning_rate: float = 7e-4
    """Of Adam, for actor, critics and entropy coefficient."""
    batch_size: int = 256
    """Transitions per update."""
    discount: float = 0.9
    """Per control step of 0.1 s: a horizon of 1 s. Feedback comes at once; farther, what a better
    step earns drowns in the noise of all that follows."""
    tau: float = 0.01
    """Share of the critics that enters their targets per update."""
    learning_starts: int = 2_000
    """Steps of uniformly random actions before learning."""
    train_freq: int = 1
    """Environment steps between updates."""
    gradient_steps: int = 1
    """Updates each time."""
    n_steps: int = 3
    """Steps of reward summed before bootstrapping."""
    critic_noise: tuple[float, float] = (0.1, 0.3)
    """Standard deviation of the noise on observations and actions that the critics are fitted to;
    without it they learn the noise of single epochs by heart."""
    target_entropy: float = -1.0
    """Entropy the policy is held to, in nats; SB3's -4 stops exploring before the hand closes."""


@dataclass(frozen=True)
class RunConfig:
    """One training run. A pure function of this object and of the p(error) rows it names."""

    condition: str
    """Training reward: "sparse", "dense" or "rlihf"."""
    seed: int
    """Seeds placement, exploration, networks and the draw of epochs."""
    total_steps: int
    """Environment steps of training (paper: 150,000)."""
    eval_every: int
    """Training steps between two evaluation points."""
    profile: str = "quick"
    """Name of the profile that chose the sizes."""
    eeg: str = "none"
    """Where p(error) comes from: "simulated", "hri", a folder's name; "none" without feedback."""
    subject: str = ""
    """Held-out subject whose epochs answer the observer; empty without feedback."""
    w_hf: float = 0.0
    """Weight of human feedback in the composite reward; 0 without feedback."""
    p_error_sha256: str = ""
    """Hash of the subject's rows of the p(error) table; empty without feedback."""
    horizon: int = 1000
    """Steps after which an episode of the evaluation is truncated (paper: 1000)."""
    patience: int = 20
    """Steps of training without progress after which an episode is truncated (paper: none)."""
    eval_rollouts: int = 5
    """Rollouts per evaluation point (paper: 5)."""
    protocol: int = PROTOCOL
    """Version of task, observer, rewards and learner."""
    sac: SACSettings = field(default_factory=SACSettings)
    """Hyper-parameters of the learner."""

    def __post_init__(self):
        if self.condition not in CONDITIONS:
            raise ValueError(
                f"condition is {self.condition!r}; choose one of {', '.join(CONDITIONS)}"
            )
        if (self.condition == "rlihf") != bool(self.subject):
            raise ValueError(
                f"condition {self.condition!r} with subject {self.subject!r}: "
                "rlihf needs a subject, the other conditions take none"
            )

    @property
    def run_id(self):
        """Readable name of the run's folder, such as `rlihf-w0.7-s05-seed3` or `dense-seed0`."""
        if self.condition == "rlihf":
            return f"rlihf-w{self.w_hf:g}-{self.subject}-seed{self.seed}"
        return f"{self.condition}-seed{self.seed}"

    def to_dict(self):
        """Return the fields as plain JSON values."""
        return dataclasses.asdict(self)

    @property
    def hash(self):
        """Hash of everything in the config: present and equal in a run folder means done."""
        return sha256(canonical_json(self.to_dict()))
