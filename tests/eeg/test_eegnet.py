import pytest

from rlihf_lib.eeg.eegnet import Architecture, EEGNet, half_second_architecture


def n_parameters(network):
    return sum(p.numel() for p in network.parameters())


def test_parameter_counts_are_the_published_ones():
    # Lawhern et al. (2018), P300 data set: 64 channels, 1 s at 128 Hz.
    assert n_parameters(EEGNet(Architecture(64, 128))) == 2258
    assert n_parameters(EEGNet(Architecture(64, 128, F1=4, F2=8))) == 1066


def test_layers_are_the_published_ones():
    # Table 2 of the paper, layer by layer: filters, kernel, groups, bias.
    network = EEGNet(Architecture(64, 128))
    assert network.temporal.weight.shape == (8, 1, 1, 64)
    assert network.spatial.weight.shape == (16, 1, 64, 1) and network.spatial.groups == 8
    assert network.separable.weight.shape == (16, 1, 1, 16) and network.separable.groups == 16
    assert network.pointwise.weight.shape == (16, 16, 1, 1)
    assert network.dense.weight.shape == (2, 16 * (128 // 32))
    biased = [name for name, _ in network.named_parameters() if name.endswith("bias")]
    assert sorted(biased) == ["dense.bias", "norm1.bias", "norm2.bias", "norm3.bias"]


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="20 samples are too few"):
        Architecture(5, 20)


@pytest.mark.parametrize("sfreq", [60.0, 64.0, 100.0, 128.0])
def test_spans_are_the_same_in_seconds_at_any_rate(sfreq):
    architecture = half_second_architecture(27, round(sfreq), sfreq)
    assert architecture.kernel / sfreq == pytest.approx(0.5, abs=0.01)
    assert 24 <= sfreq / architecture.pool1 <= 43
