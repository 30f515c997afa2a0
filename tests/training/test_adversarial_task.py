"""Two networks that learn in turn: their steps, what each of them sees, and how a training goes on."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import tiny_task as tiny
import torch
from lightning import Callback
from tiny_task import LOSS, MAX_DEPTH, TinyNetwork, adam, fit, frames, tiny_task
from torch import Tensor, nn
from torch.utils.data import DataLoader

from col3d.layers.patch_gan import PatchGAN
from col3d.losses import gan_loss


class Gradients(Callback):
    """Gradients of (network, discriminator) before each step, under the name of who steps."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, list[Tensor | None], list[Tensor | None]]] = []

    def on_before_optimizer_step(self, trainer: Any, pl_module: Any, optimizer: Any) -> None:
        who = "network" if optimizer is trainer.optimizers[0] else "discriminator"
        self.seen.append((who, gradients(pl_module.network), gradients(pl_module.discriminator)))


def patch_gan() -> nn.Module:
    return PatchGAN(width=16)


def gradients(network: nn.Module) -> list[Tensor | None]:
    return [None if p.grad is None else p.grad.clone() for p in network.parameters()]


def norm(gradient: list[Any]) -> float:
    return torch.cat([g.flatten() for g in gradient]).norm().item()


def assert_equal_states(found: nn.Module, expected: dict[str, Tensor]) -> None:
    state = found.state_dict()
    assert state.keys() == expected.keys()
    for name, value in expected.items():
        assert torch.equal(state[name], value), name


def test_steps_are_those_of_plain_pytorch_bit_for_bit() -> None:
    task = tiny_task(patch_gan)
    network, critic = TinyNetwork(0.0), patch_gan()
    network.load_state_dict(task.network.state_dict())
    critic.load_state_dict(task.discriminator.state_dict())
    fit(task, max_epochs=2)
    for_network, for_critic = adam(network), adam(critic)
    for step, batch in enumerate([*DataLoader(frames(), batch_size=2)] * 2):  # type: ignore[arg-type]
        for optimizer in (for_network, for_critic):
            optimizer.param_groups[0]["lr"] = 1e-2 if step < 3 else 5e-3

        def judge(depth: Tensor, image: Tensor = batch["image"], mask: Tensor = batch["mask"]) -> Tensor:
            scaled = 2 * (depth * mask) / MAX_DEPTH - 1
            found: Tensor = critic(torch.cat([2 * image - 1, scaled], dim=1))
            return found

        prediction = network(batch["image"], batch["rays"])
        told = gan_loss(judge(prediction["depth"].detach()), real=False)
        told = 0.5 * (told + gan_loss(judge(batch["depth"]), real=True))
        for_critic.zero_grad()
        told.backward()
        for_critic.step()
        fooled = gan_loss(judge(prediction["depth"]), real=True)
        for_network.zero_grad()
        (LOSS(prediction, batch)["total"] + 2 * fooled).backward()
        for_network.step()
    assert_equal_states(task.network, network.state_dict())
    assert_equal_states(task.discriminator, critic.state_dict())


def test_both_networks_learn_and_each_step_touches_one_sides_gradients_alone() -> None:
    task, watch = tiny_task(), Gradients()
    before = {name: value.clone() for name, value in task.named_parameters()}
    fit(task, watch)
    assert all(not torch.equal(before[name], value) for name, value in task.named_parameters())
    assert [who for who, *_ in watch.seen] == ["discriminator", "network"] * 2
    assert all(gradient is None for gradient in watch.seen[0][1])
    for (_, network, critic), (who, later_network, later_critic) in zip(
        watch.seen, watch.seen[1:], strict=False
    ):
        kept, later = (critic, later_critic) if who == "network" else (network, later_network)
        assert all(torch.equal(a, b) for a, b in zip(kept, later, strict=True))  # type: ignore[arg-type]


def test_gradients_are_clipped_to_the_norm() -> None:
    free, clipped = Gradients(), Gradients()
    fit(tiny_task(), free)
    fit(tiny_task(gradient_clip=1e-3), clipped)
    for watch, expected in ((free, None), (clipped, 1e-3)):
        for who, network, critic in watch.seen:
            length = norm(network if who == "network" else critic)
            assert length > 2e-3 if expected is None else length == pytest.approx(expected, rel=1e-2)


def test_unknown_depth_tells_the_discriminator_nothing() -> None:
    task = tiny_task()
    seen: list[Tensor] = []
    task.discriminator.register_forward_pre_hook(lambda _, given: seen.append(given[0].detach().clone()))
    fit(task, batch_size=4)
    fake, real, fake_again = seen
    batch = next(iter(DataLoader(frames(), batch_size=4)))  # type: ignore[arg-type]
    known = batch["mask"][:, 0]
    for pair in seen:
        assert (pair[:, 3][~known] == -1).all()
        torch.testing.assert_close(pair[:, :3], 2 * batch["image"] - 1)
    assert torch.equal(fake, fake_again)
    torch.testing.assert_close(real[:, 3][known], batch["depth"][:, 0][known] / 50 - 1)
    assert not torch.isclose(fake[:, 3][known], real[:, 3][known]).all()


def test_both_schedules_step_once_a_batch() -> None:
    asked = []

    def schedule(optimizer: Any, steps: int, epochs: int) -> Any:
        asked.append((steps, epochs))
        return tiny.halved_every_third_step(optimizer, steps, epochs)

    trainer = fit(tiny_task(scheduler=schedule), batch_size=1, max_epochs=2)
    assert asked == [(8, 2)] * 2
    assert [o.param_groups[0]["lr"] for o in trainer.optimizers] == [1e-2 / 4] * 2


def test_a_constant_rate_has_no_schedule() -> None:
    trainer = fit(tiny_task(scheduler=None), max_epochs=2)
    assert [o.param_groups[0]["lr"] for o in trainer.optimizers] == [1e-2] * 2


def test_every_loss_is_logged_as_its_mean() -> None:
    still = tiny_task(optimizer=lambda net: torch.optim.SGD(net.parameters(), lr=0.0))
    logged, whole = fit(still).callback_metrics, fit(tiny_task(), batch_size=4).callback_metrics
    names = {f"train/{name}" for name in ("loss", "loss_depth", "loss_adversarial", "loss_discriminator")}
    about = {"train/lr", "train/frames_without_truth"}
    assert {name for name in logged if name.startswith("train/")} == names | about
    for name in names - {"train/loss_adversarial"}:  # whose discriminator has learned in `whole`
        torch.testing.assert_close(logged[name], whole[name])
    torch.testing.assert_close(logged["train/loss"], 100 * logged["train/loss_depth"])


def test_a_training_that_was_cut_off_goes_on_to_the_same_weights(tmp_path: Path) -> None:
    whole, cut, resumed = (tiny_task(patch_gan, dropout=0.5) for _ in range(3))
    fit(whole, max_epochs=3)
    fit(cut).save_checkpoint(tmp_path / "cut.ckpt")
    torch.manual_seed(99)
    fit(resumed, max_epochs=3, ckpt_path=tmp_path / "cut.ckpt")
    assert_equal_states(resumed, whole.state_dict())


def test_every_step_epoch_and_seed_draws_numbers_of_its_own() -> None:
    def draws(seed: int) -> list[float]:
        task, drawn = tiny_task(seed=seed), []
        task.discriminator.register_forward_pre_hook(lambda *_: drawn.append(torch.rand(1).item()))
        fit(task, max_epochs=2)
        return drawn

    first = draws(1)
    assert first == draws(1)
    assert len({*first, *draws(2)}) == 2 * len(first) == 2 * 3 * 2 * 2


@pytest.mark.end_to_end
def test_two_processes_take_the_steps_that_one_takes_with_the_frames_of_both(tmp_path: Path) -> None:
    """Lightning starts the second process by the command line, so this runs a program."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, tiny.__file__, str(tmp_path / "two.pt")]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    alone = tiny_task()
    fit(alone, batch_size=2)
    two = torch.load(tmp_path / "two.pt", weights_only=True)
    for name, value in alone.state_dict().items():
        torch.testing.assert_close(two[name], value, atol=1e-5, rtol=1e-5)
