import pytest
import torch

from rlihf_lib.eeg.eegnet import Architecture, EEGNet
from rlihf_lib.eeg.ensemble import EEGNetBatch

SMALL = Architecture(5, 40, kernel=20, kernel_separable=8, pool1=2, pool2=4, dropout=0.0)


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
