"""Waves of a sea and a vessel's answers: density, variance and components against closed forms."""

import gymnasium
import numpy as np
import pytest
from scipy import integrate

from sins_env import attitude
from sins_env.trajectory import Sway, SwayMotion
from sins_env.trajectory.spectrum import Answer, Spectrum
from sins_env.types import Site
from sins_env.units import DEG

SEA = {"kind": "jonswap", "height_m": 1.2, "peak_period_s": 8.0, "roll": {"deg_per_m": 3.0}, "heave": {"m_per_m": 0.8}}


def test_the_density_is_that_of_the_closed_forms():
    """Bretschneider: 5/16 H^2 w_p^4 w^-5 exp(-5/4 (w_p / w)^4). JONSWAP: Goda's factor 1 - .287 ln gamma, good to 2 %."""
    omega, peak = np.linspace(0.3, 5, 400), 2 * np.pi / 8
    plain = 5 / 16 * 1.2**2 * peak**4 * omega**-5.0 * np.exp(-1.25 * (peak / omega) ** 4)
    sea = Spectrum.of({**SEA, "kind": "bretschneider"})
    np.testing.assert_allclose(sea.density(omega), plain, rtol=1e-3)
    width = np.where(omega > peak, 0.09, 0.07)
    higher = 3.3 ** np.exp(-0.5 * ((omega / peak - 1) / width) ** 2)
    np.testing.assert_allclose(Spectrum.of(SEA).density(omega), (1 - 0.287 * np.log(3.3)) * plain * higher, rtol=0.025)


@pytest.mark.parametrize("answer", [Answer(2.0), Answer(2.0, natural_period_s=9.0, damping=0.05)])
def test_the_variance_of_the_components_is_that_of_the_answer(answer):
    """The response of an oscillator is 1 / |1 - r^2 + 2 i z r|; its variance is an integral, whatever the number of components."""
    for count in (4, 200):
        sea = Spectrum("jonswap", 1.2, 8.0, components=count, answers={"roll": answer})

        def power(w, sea=sea):
            r = w * 9.0 / (2 * np.pi) if answer.natural_period_s else 0.0
            return float(sea.density(np.array(w))) * abs(2.0 / (1 - r**2 + 2j * answer.damping * r)) ** 2

        expected = integrate.quad(power, 0.25, 6.2, limit=400, points=[0.7, 0.785])[0]
        amplitude, omega = sea.waves("roll")
        assert len(amplitude) == count
        assert np.sum(amplitude**2) / 2 == pytest.approx(expected, rel=2e-3)
        assert (np.diff(omega) > 0).all()


def test_the_motion_has_the_spectrum():
    """A quarter of an hour of 16 runs: standard deviations of roll and heave, and the shares of their variance above the peak."""
    motion = SwayMotion.of({"spectrum": SEA})
    base = Sway(Site(0.9, 0.1, 0.0), 0.5, 1, motion)
    base.reset([np.random.default_rng(i) for i in range(16)])
    state, _ = base.states(np.arange(1800) * 0.5)
    _, pitch, roll = attitude.to_euler(attitude.to_dcm(state.q_nb))
    height = state.pos[..., 2]
    for values, expected in ((roll / DEG, 3.0 * 0.3), (height, 0.8 * 0.3)):
        assert values.std() == pytest.approx(expected, rel=0.02)
        kurtosis = (values**4).mean() / (values**2).mean() ** 2
        assert 2.8 < kurtosis < 3.1  # a sum of 24 sinusoids is nearly Gaussian
    np.testing.assert_allclose(pitch, 0.0, atol=1e-12)
    power = (np.abs(np.fft.rfft(height - height.mean(), axis=1)) ** 2).mean(axis=0)
    omega = 2 * np.pi * np.fft.rfftfreq(1800, 0.5)
    shares = [power[omega > w].sum() / power.sum() for w in (0.785, 1.2)]
    grid = np.linspace(0.25, 6.2, 20_000)
    density = Spectrum.of(SEA).density(grid)
    np.testing.assert_allclose(shares, [density[grid > w].sum() / density.sum() for w in (0.785, 1.2)], atol=0.03)


def test_components_of_ones_own_stay_beside_the_sea():
    found = SwayMotion.of({"roll": {"amplitude_deg": 1.0}, "yaw": {"amplitude_deg": 2.0}, "spectrum": SEA}).components
    assert {name: len(ones) for name, ones in found.items()} == {"yaw": 1, "roll": 25, "heave": 24}
    assert set(SwayMotion.of({"spectrum": {"height_m": 0.5}}).components) == {"roll", "pitch", "heave"}


@pytest.mark.parametrize(
    ("change", "said"),
    [({"kind": "jonswp"}, "did you mean 'jonswap'"), ({"hight_m": 1}, "did you mean 'height_m'"), ({"gamma": 0.5}, "gamma"),
     ({"roll": {"m_per_m": 1}}, "roll = .* a dict with deg_per_m"), ({"roll": {"deg_per_m": 1, "dampng": 1}}, "did you mean"),
     ({"roll": {"deg_per_m": -1}}, "roll.deg_per_m"), ({"components": 3}, "components"), ({"height_m": 0}, "height_m"),
     ({"roll": {"deg_per_m": 180}}, "the amplitudes of roll add up to"), ({"roll": 3}, "a dict with deg_per_m")],
)  # fmt: skip
def test_refused_seas(change, said):
    with pytest.raises(ValueError, match=said):
        gymnasium.make("SINS/AlignSway-v0", motion={"spectrum": {**SEA, **change}})
