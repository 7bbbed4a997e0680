"""Make the reference numbers of `gpytorch_posterior.json` with GPyTorch, without this package.

Run it where GPyTorch is installed: `python gpytorch_posterior.py [OUTPUT]`.

A GP is conditioned on values and gradients at nodes of unit size; the posterior of values and
gradients at queries and the log marginal likelihood are recorded. `amplitudes` multiply
the prior's and the noise's standard deviation alike.
"""

from __future__ import annotations

import json
import platform
import sys
from pathlib import Path

import gpytorch
import numpy as np
import torch

OUTPUT = Path(__file__).with_suffix(".json")
NODES, QUERIES = 12, 8
MEAN, VALUE_NOISE, GRADIENT_NOISE = 1.0, 0.01, 0.1
AMPLITUDES = [0.5, 1.0, 2.0]
KERNELS = {
    "rbf": (gpytorch.kernels.RBFKernelGrad, 0.4),
    "matern52": (gpytorch.kernels.Matern52KernelGrad, 0.8),
}


class Process(gpytorch.models.ExactGP):
    """A constant mean and one kernel, values and gradients."""

    def __init__(
        self,
        nodes: torch.Tensor,
        targets: torch.Tensor,
        likelihood: gpytorch.likelihoods.Likelihood,
        kernel: gpytorch.kernels.Kernel,
    ) -> None:
        super().__init__(nodes, targets, likelihood)
        self.mean_module = gpytorch.means.ConstantMeanGrad()
        self.covar_module = gpytorch.kernels.ScaleKernel(kernel)

    def forward(self, x: torch.Tensor) -> gpytorch.distributions.MultitaskMultivariateNormal:
        return gpytorch.distributions.MultitaskMultivariateNormal(
            self.mean_module(x), self.covar_module(x)
        )


def make_process(
    name: str, nodes: torch.Tensor, targets: torch.Tensor, amplitude: float
) -> Process:
    kind, length = KERNELS[name]
    likelihood = gpytorch.likelihoods.MultitaskGaussianLikelihood(
        num_tasks=4, has_global_noise=False, noise_constraint=gpytorch.constraints.Positive()
    )
    likelihood.initialize(
        task_noises=amplitude**2 * torch.tensor([VALUE_NOISE**2, *[GRADIENT_NOISE**2] * 3])
    )
    model = Process(nodes, targets, likelihood, kind())
    model.covar_module.base_kernel.lengthscale = length
    model.covar_module.outputscale = amplitude**2
    model.mean_module.constant.data.fill_(MEAN)
    return model


def main(output: Path) -> None:
    torch.set_default_dtype(torch.float64)
    rng = np.random.default_rng(20260101)
    normals = rng.normal(size=(NODES, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    nodes = normals * [0.5, 0.4, 0.3]  # not a sphere, and these are not its normals: no symmetry
    queries = rng.uniform(-0.6, 0.6, (QUERIES, 3))
    targets = np.column_stack([np.zeros(NODES), normals])
    x, y, z = (torch.from_numpy(a) for a in (nodes, targets, queries))
    record: dict[str, object] = {
        "versions": {
            "python": platform.python_version(),
            "gpytorch": gpytorch.__version__,
            "torch": torch.__version__.split("+")[0],
            "numpy": np.__version__,
        },
        "mean": MEAN,
        "value_noise": VALUE_NOISE,
        "gradient_noise": GRADIENT_NOISE,
        "amplitudes": AMPLITUDES,
        "nodes": nodes.tolist(),
        "normals": normals.tolist(),
        "queries": queries.tolist(),
    }
    dense = gpytorch.settings.fast_computations(
        covar_root_decomposition=False, log_prob=False, solves=False
    )
    with dense, torch.no_grad(), gpytorch.settings.fast_pred_var(False):
        for name, (_, length) in KERNELS.items():
            likelihoods = []
            for amplitude in AMPLITUDES:
                model = make_process(name, x, y, amplitude)
                prior = model.likelihood(model(x))  # in training mode: the prior
                likelihoods.append(float(prior.log_prob(y)))
            model = make_process(name, x, y, 1.0).eval()
            posterior = model(z)
            record[name] = {
                "length": length,
                "mean": posterior.mean[:, 0].tolist(),
                "gradient": posterior.mean[:, 1:].tolist(),
                "variance": posterior.variance[:, 0].tolist(),
                "log_likelihoods": likelihoods,
            }
    output.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUTPUT)
