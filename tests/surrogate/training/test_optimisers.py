"""Optimiser steps: equal in all directions of a matrix, by group, skipped for gradients that are not finite, resumable."""

import pytest

torch = pytest.importorskip("torch", reason='torch is not installed; get it with: pip install "ngbrain[train]"')

from torch import nn  # noqa: E402

from ngbrain.surrogate.training.optimisers import MATRICES, Descent, Muon  # noqa: E402

torch.set_num_threads(1)


class Net(nn.Module):
    """A layer of each kind: full, in groups, a bare weight of many axes, and biases."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.line = nn.Linear(6, 6)
        self.grouped = nn.Conv2d(6, 9, 3, padding=1, groups=3)
        self.bare = nn.Parameter(torch.randn(9, 2, 2, 2))

    def forward(self, x):
        y = self.grouped(self.line(x).T.reshape(1, 6, 4, -1))
        return (y.mean((0, 2, 3)) * self.bare.sum((1, 2, 3))).tanh().square().sum()


def test_everything_moves():
    net, x = Net(), torch.randn(16, 6)
    before = {name: p.detach().clone() for name, p in net.named_parameters()}
    descent = Descent(net, 0.02, 50)
    losses = []
    for _ in range(30):
        loss = net(x)
        losses.append(loss.item())
        assert descent.step(loss)
    assert all((p != before[name]).all() for name, p in net.named_parameters())
    assert losses[-1] < 0.3 * losses[0]


def stepped(net, loss, rate=1.0):
    """Change of the weights in the first of many steps."""
    before = {name: p.detach().clone() for name, p in net.named_parameters()}
    Descent(net, rate, 1000).step(loss)
    return {name: p.detach() - before[name] for name, p in net.named_parameters()}


def test_all_directions_of_a_matrix_learn_alike():
    """A gradient UΣVᵀ with Σ over two decades gives a step along -UVᵀ."""
    torch.manual_seed(1)
    u, v = (torch.linalg.qr(torch.randn(5, 5))[0] for _ in range(2))
    slope = u @ torch.diag(torch.logspace(-1, 1, 5)) @ v.T
    net = nn.Linear(5, 5)
    nn.init.zeros_(net.weight)
    along = -u.T @ stepped(net, (net.weight * slope).sum())["weight"] @ v
    sizes = along.diagonal() / along.diagonal().mean()
    assert (along - along.diag().diag()).abs().max() < 0.05 * along.diagonal().mean()
    assert sizes.min() > 0.6 and sizes.max() < 1.4


def test_groups_are_matrices_of_their_own():
    """A thousandth of the gradient in one group gives as large a step there as for the group alone."""
    torch.manual_seed(2)
    slope = torch.randn(6, 2, 3, 3)
    slope[3:] *= 1e-3
    both, alone = nn.Conv2d(4, 6, 3, groups=2), nn.Conv2d(2, 3, 3)
    with torch.no_grad():
        alone.weight.copy_(both.weight[3:])
    step = stepped(both, (both.weight * slope).sum())["weight"]
    assert step[3:].norm().item() == pytest.approx(step[:3].norm().item(), rel=0.2)
    torch.testing.assert_close(
        step[3:], stepped(alone, (alone.weight * slope[3:]).sum())["weight"], rtol=0.1, atol=1e-3
    )


def test_what_is_no_layers_moves_entry_by_entry():
    """The first step of AdamW is equally long for every entry."""
    net = Net()
    step = stepped(net, (net.bare * torch.logspace(-2, 2, 72).reshape(9, 2, 2, 2)).sum() + net(torch.ones(4, 6)))[
        "bare"
    ]
    assert (step < 0).float().mean() > 0.9 and step.abs().std() < 0.01 * step.abs().mean()


def test_a_slope_that_is_not_finite_leaves_the_weights():
    net, x = Net(), torch.randn(16, 6)
    descent = Descent(net, 0.02, 50)
    assert descent.step(net(x))
    before = [p.detach().clone() for p in net.parameters()]
    assert not descent.step(net(x) * torch.inf)
    assert all(torch.equal(p, q) for p, q in zip(net.parameters(), before, strict=True))
    assert descent.step(net(x)) and all(torch.isfinite(p).all() for p in net.parameters())


def test_it_goes_on_to_the_same_bits(tmp_path):
    def some(net, descent, steps):
        for seed in steps:
            torch.manual_seed(seed)
            descent.step(net(torch.randn(16, 6)))

    through, stopped, resumed = Net(), Net(), Net()
    some(through, Descent(through, 0.02, 8), range(8))
    descent = Descent(stopped, 0.02, 8)
    some(stopped, descent, range(5))
    torch.save({"net": stopped.state_dict(), "descent": descent.state_dict()}, tmp_path / "saved")
    saved = torch.load(tmp_path / "saved", weights_only=True)
    descent = Descent(resumed, 0.02, 8)
    resumed.load_state_dict(saved["net"])
    descent.load_state_dict(saved["descent"])
    some(resumed, descent, range(5, 8))
    assert all(torch.equal(p, q) for p, q in zip(through.parameters(), resumed.parameters(), strict=True))


def test_weights_that_are_no_rows_in_memory_move_alike():
    rows, columns = (nn.Conv2d(4, 6, 3) for _ in range(2))
    columns.load_state_dict(rows.state_dict())
    columns.to(memory_format=torch.channels_last)
    slope = torch.randn(6, 4, 3, 3)
    steps = [stepped(net, (net.weight * slope).sum())["weight"] for net in (rows, columns)]
    torch.testing.assert_close(*steps)


@pytest.mark.parametrize("shape", [(12, 8), (8, 12)])
def test_steps_are_those_of_pytorchs_own(shape):
    """PyTorch's Muon rounds to bfloat16: ten steps of large weights, with weight decay, differ by less than 2 %."""
    torch.manual_seed(3)
    ours, theirs = (nn.Parameter(50 * weights) for weights in 2 * [torch.randn(shape)])
    before = ours.detach().clone()
    descent, peer = Muon({ours: 1}, 0.05), torch.optim.Muon([theirs], lr=0.05, weight_decay=MATRICES)
    for _ in range(10):
        ours.grad = theirs.grad = torch.randn(shape)
        descent.step()
        peer.step()
    moved, apart = (a.detach() - b for a, b in ((ours, before), (ours, theirs)))
    assert apart.norm() < 0.02 * moved.norm()
