"""Whether a torque in another form than its term has does what a smaller effect does.

No term has exactly the form that a torque has on an axis: friction that follows the load also depends a little on speed and
place. What the form does not meet comes back as regularly as an effect. In: the fit without the effect, and the larger torque
T(t), N m. The other forms are

    T(t) (f(position) + g(speed) + h(own coordinate))

with any continuous functions f, g, h that are linear between nodes, and their gain is that of a joint fit to first order.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse, stats

from tcs_friction.conditioning.data_set import DataSet
from tcs_friction.diagnose.dataset.basis import hats
from tcs_friction.diagnose.dataset.coordinates import values_of
from tcs_friction.diagnose.search.projection import ProjectedResidual
from tcs_friction.physics.terms import Instance

NODES = 12  # of each function, with as many samples between any two
OWN = ("acceleration", "temperature", "time")  # a term's coordinates that count: noise of the logged torque is in the residual


def gain_in_other_forms(projected: ProjectedResidual, torque: np.ndarray, larger: Instance) -> float:
    """Drop of the whitened squares by a torque (n,), N m, in other forms than its term's, beyond that of chance.

    larger: the effect whose torque it is.
    """
    data = projected.balance.data
    weights = sparse.hstack([hats(stats.rankdata(x), NODES) for x in _coordinates(data, larger)]).toarray()
    columns = projected.project(np.stack([projected.noise.whiten(torque * weight) for weight in weights.T], axis=1))
    norms = np.linalg.norm(columns, axis=0)
    return projected.gain(columns / np.where(norms > 0.0, norms, 1.0))[0] - columns.shape[1] * projected.dispersion


def _coordinates(data: DataSet, item: Instance) -> list[np.ndarray]:
    """What the form of an effect may depend on, (n,) each: position, speed, and what its term has."""
    found, own = [data.joined("position"), np.abs(data.joined("velocity"))], item.term.coordinate
    return [*found, values_of(data, own)] if own in OWN else found
