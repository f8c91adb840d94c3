import pytest
import torch

from rlihf_lib.eeg.eegnet import Architecture, EEGNet, EEGNetBatch, half_second_architecture

SMALL = Architecture(5, 40, kernel=20, kernel_separable=8, pool1=2, pool2=4, dropout=0.0)


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


@pytest.fixture
def pair():
    batch = EEGNetBatch(SMALL, seeds=[3, 4, 5]).double()
    networks = [EEGNet(SMALL).double() for _ in range(3)]
    for i, network in enumerate(networks):
        network.load_state_dict(batch.network_state(i), strict=False)
    epochs = torch.randn(3, 12, 5, 40, generator=torch.Generator().manual_seed(0)).double()
    return batch, networks, epochs


def run_both(batch, networks, epochs):
    moments = [batch.patch_moments(x) for x in epochs]
    means = tuple(torch.stack([m[part].mean(0) for m in moments]) for part in (0, 1))
    together = batch(epochs.permute(2, 0, 1, 3).contiguous(), means)
    return together, torch.stack([n(x) for n, x in zip(networks, epochs, strict=True)])


def test_networks_trained_as_one_equal_the_published_network(pair):
    batch, networks, _ = pair
    together, alone = run_both(*pair)
    torch.testing.assert_close(together, alone)
    weight = torch.randn(together.shape, generator=torch.Generator().manual_seed(1)).double()
    (together * weight).sum().backward()
    (alone * weight).sum().backward()
    for i, network in enumerate(networks):
        for name, parameter in network.named_parameters():
            gradient = getattr(batch, name.replace(".", "_")).grad[i]
            torch.testing.assert_close(gradient, parameter.grad, atol=1e-10, rtol=1e-6)


def test_networks_as_one_equal_the_published_network_after_training_steps(pair):
    batch, networks, epochs = pair
    for module in (batch, *networks):
        optimizer = torch.optim.SGD(module.parameters(), lr=0.5)
        for _ in range(5):
            optimizer.zero_grad()
            i = networks.index(module) if module is not batch else None
            if i is None:
                out = run_both(batch, networks, epochs)[0]
            else:
                out = module(epochs[i])
            out[..., 1].sum().backward()
            optimizer.step()
            module.constrain()
    batch.eval()
    for i, network in enumerate(networks):
        network.load_state_dict(batch.network_state(i), strict=False)
        network.eval()
        norms = network.spatial.weight.flatten(1).norm(dim=1)
        assert norms.max() <= 1 + 1e-9
        assert network.dense.weight.norm(dim=1).max() <= 0.25 + 1e-9
    together, alone = run_both(batch, networks, epochs)
    torch.testing.assert_close(together, alone)


def test_max_norm_of_both_forms_agree(pair):
    batch, networks, _ = pair
    with torch.no_grad():
        for module in (batch, *networks):
            for parameter in module.parameters():
                parameter.mul_(3)
            module.constrain()
    for i, network in enumerate(networks):
        for name, value in network.named_parameters():
            torch.testing.assert_close(getattr(batch, name.replace(".", "_"))[i], value)


def test_a_networks_initial_weights_depend_on_its_seed_alone():
    one, three = EEGNetBatch(SMALL, [7]), EEGNetBatch(SMALL, [1, 7, 2])
    assert torch.equal(one.temporal_weight[0], three.temporal_weight[1])
    assert not torch.equal(one.temporal_weight[0], three.temporal_weight[0])


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="20 samples are too few"):
        Architecture(5, 20)


@pytest.mark.parametrize("sfreq", [60.0, 64.0, 100.0, 128.0])
def test_spans_are_the_same_in_seconds_at_any_rate(sfreq):
    architecture = half_second_architecture(27, round(sfreq), sfreq)
    assert architecture.kernel / sfreq == pytest.approx(0.5, abs=0.01)
    assert 24 <= sfreq / architecture.pool1 <= 43
