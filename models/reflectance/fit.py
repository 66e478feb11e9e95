"""Coefficients of the reflectance of rough surfaces, in `light.h` and `object.frag`.

    python -m models.reflectance.fit

The integral of the microfacet lobe over all directions (Karis 2013) is F0 * scale + bias, two
functions of the cosine to the eye and of alpha, the square of the roughness. Each becomes a
quotient of two polynomials, so that the largest relative error of what surfaces of F0 0.02 to 1
reflect is least.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

COSINES = np.concatenate([[0.02, 0.04, 0.07], np.linspace(0.1, 1.0, 19)])
ROUGHNESSES = np.linspace(0.045, 1.0, 24)
REFLECTANCES = (0.02, 0.04, 0.1, 0.3, 1.0)
DIELECTRIC = 0.04
TERMS = 9  # cosine and alpha, each up to its square
POWER = 6  # of the errors that are summed: the largest ones count
STEPS = 4000
LEAST_DIVISOR = 0.02


def lobe_integral(cosine: float, roughness: float, count: int = 256) -> tuple[float, float]:
    """What F0 is multiplied by, and what is added, for the lobe of Trowbridge and Reitz.

    Args:
        cosine: between normal and eye, above 0 [1].
        roughness: perceptual, 0 to 1 [1].
        count: samples along each axis.
    """
    alpha2 = roughness**4
    at = (np.arange(count) + 0.5) / count
    share, turn = np.meshgrid(at, at, indexing="ij")
    half_z = np.sqrt((1.0 - share) / (1.0 + (alpha2 - 1.0) * share))
    half_x = np.sqrt(1.0 - half_z**2) * np.cos(2.0 * np.pi * turn)
    eye_half = np.sqrt(1.0 - cosine**2) * half_x + cosine * half_z
    light_z = 2.0 * eye_half * half_z - cosine
    seen = (light_z > 0.0) & (eye_half > 0.0)
    light_z = np.where(seen, light_z, 1.0)
    masking = 0.5 / (
        light_z * np.sqrt(cosine**2 * (1.0 - alpha2) + alpha2)
        + cosine * np.sqrt(light_z**2 * (1.0 - alpha2) + alpha2)
    )
    lobe = np.where(seen, 4.0 * masking * light_z * np.clip(eye_half, 0.0, None) / half_z, 0.0)
    edge = (1.0 - np.clip(eye_half, 0.0, 1.0)) ** 5
    return float(((1.0 - edge) * lobe).mean()), float((edge * lobe).mean())


def monomials(cosine: Floats, alpha: Floats) -> Floats:
    """Products of powers (N, 9): cosine in the outer loop, alpha in the inner one."""
    return np.stack([cosine**i * alpha**j for i in range(3) for j in range(3)], axis=1)


def quotient(coefficients: Floats, terms: Floats) -> tuple[Floats, Floats]:
    """Values (N,) of a quotient of polynomials, and its divisors, whose constant is 1."""
    divisor = 1.0 + terms[:, 1:] @ coefficients[TERMS:]
    return terms @ coefficients[:TERMS] / divisor, divisor


def linear_fit(values: Floats, weights: Floats, terms: Floats) -> Floats:
    """A quotient (17,) near to values: least squares by the last divisors (Sanathanan 1963)."""
    divisor, best, least = np.ones_like(values), np.zeros(2 * TERMS - 1), np.inf
    for _ in range(60):
        rows = np.concatenate([terms, -values[:, None] * terms[:, 1:]], axis=1)
        scale = weights / divisor
        found = np.linalg.lstsq(rows * scale[:, None], values * scale, rcond=1e-12)[0]
        made, divisor = quotient(found, terms)
        if (divisor <= 0.0).any():
            divisor = np.abs(divisor) + 1e-3
            continue
        error = float(np.abs((made - values) * weights).max())
        if error < least:
            best, least = found, error
    return best


class Fit:
    """Both quotients, fitted together.

    Args:
        scale: values (N,) that F0 is multiplied by.
        bias: values (N,) that are added.
        terms: monomials (N, 9) of their places.
    """

    def __init__(self, scale: Floats, bias: Floats, terms: Floats) -> None:
        self._terms = terms
        self._truths = [f0 * scale + bias for f0 in REFLECTANCES]
        by_size = 1.0 / (DIELECTRIC * scale + bias)
        self.coefficients = np.concatenate(
            [linear_fit(scale, np.ones_like(scale), terms), linear_fit(bias, by_size, terms)]
        )

    def errors(self, coefficients: Floats) -> Floats:
        """Relative errors of what surfaces reflect (5 N,)."""
        scale, bias = self._quotients(coefficients)
        return np.concatenate(
            [
                (f0 * scale[0] + bias[0]) / truth - 1.0
                for f0, truth in zip(REFLECTANCES, self._truths, strict=True)
            ]
        )

    def refine(self) -> None:
        """Damped Gauss-Newton steps (Levenberg and Marquardt) on the sum of `POWER`th powers."""
        cost, damping = self._cost(self.coefficients), 1e-3
        for _ in range(STEPS):
            errors = self.errors(self.coefficients)
            weights = np.abs(errors) ** (POWER / 2 - 1) + 1e-6
            slopes = self._slopes() * weights[:, None]
            normal = slopes.T @ slopes
            step = np.linalg.lstsq(
                normal + damping * np.diag(np.diag(normal)),
                -(slopes.T @ (errors * weights)),
                rcond=1e-14,
            )[0]
            tried = self.coefficients + 0.5 * step
            found = self._cost(tried)
            if found < cost:
                self.coefficients, cost, damping = tried, found, max(damping / 2.0, 1e-9)
            elif damping < 1e6:
                damping *= 3.0
            else:
                return

    def _quotients(self, coefficients: Floats) -> list[tuple[Floats, Floats]]:
        return [quotient(part, self._terms) for part in np.split(coefficients, 2)]

    def _cost(self, coefficients: Floats) -> float:
        if min(divisor.min() for _, divisor in self._quotients(coefficients)) <= LEAST_DIVISOR:
            return np.inf
        return float((np.abs(self.errors(coefficients)) ** POWER).sum())

    def _slopes(self) -> Floats:
        """Derivatives of the errors by the coefficients (5 N, 34)."""
        scale, bias = (
            np.concatenate([terms, -value[:, None] * terms[:, 1:]], axis=1) / divisor[:, None]
            for terms, (value, divisor) in zip(
                [self._terms] * 2, self._quotients(self.coefficients), strict=True
            )
        )
        return np.concatenate(
            [
                np.concatenate([f0 * scale, bias], axis=1) / truth[:, None]
                for f0, truth in zip(REFLECTANCES, self._truths, strict=True)
            ]
        )


def main() -> None:
    """Print the coefficients and the largest error."""
    values = np.array([[lobe_integral(c, r) for r in ROUGHNESSES] for c in COSINES])
    cosine, roughness = (axis.ravel() for axis in np.meshgrid(COSINES, ROUGHNESSES, indexing="ij"))
    fit = Fit(values[..., 0].ravel(), values[..., 1].ravel(), monomials(cosine, roughness**2))
    fit.refine()
    for name, part in zip(("Scale", "Bias"), np.split(fit.coefficients, 2), strict=True):
        print(f"k{name}: {', '.join(f'{c:.5f}' for c in part[:TERMS])}")
        print(f"k{name}Divisor: 1, {', '.join(f'{c:.5f}' for c in part[TERMS:])}")
    print(f"largest relative error: {np.abs(fit.errors(fit.coefficients)).max():.1%}")


if __name__ == "__main__":
    main()
