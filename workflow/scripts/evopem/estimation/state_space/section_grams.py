"""Gram matrices of the signals of sections, without sums over samples of the products of any two.

The signals v of a section, two each, follow ``v+ = F v + z``.  The sum G of ``v_i v_j'`` over the
samples of segments so solves Stein's equation ``G - F_i G F_j' = F_i (z_j v_i')' + (z_i v_j') F_j'
+ z_i z_j' + E``, in which products stand for their sums, and E is what the ends of segments add.
Sources z are the drives or the states, which responses add up to: only products with the drives are
summed over samples.  Sums are tensors, whose first axes are those of v or z: (2, sections, signals
of a section); those of states are (2, sections).
"""

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array
from evopem.compilation import cached_njit
from evopem.estimation.state_space.sections import SectionArrays, SectionSignals

# Which state, the last axis, drives a signal, the first one, of derivatives by sigma and by delta.
STATES_DRIVE = np.array([[[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]]])


@cached_njit
def stein(sigma, coupling, back, inverse, z_w, u_v, rest):
    """Solve for the sums of ``v w'``, (2, S, i, 2, S, j), of v driven by z and w by u."""
    out = np.empty(rest.shape)
    right = np.empty(4)
    _, sections, lefts, _, _, rights = rest.shape
    for m in range(sections):
        for i in range(lefts):
            for k in range(sections):
                for j in range(rights):
                    for c in range(2):
                        # F v u', then z w' F'.
                        p, r = u_v[c, k, j, 0, m, i], u_v[c, k, j, 1, m, i]
                        right[c] = rest[0, m, i, c, k, j] + sigma[m] * p + back[m] * r
                        right[2 + c] = rest[1, m, i, c, k, j] + coupling[m] * p + sigma[m] * r
                    for c in range(2):
                        p, r = z_w[c, m, i, 0, k, j], z_w[c, m, i, 1, k, j]
                        right[2 * c] += sigma[k] * p + back[k] * r
                        right[2 * c + 1] += coupling[k] * p + sigma[k] * r
                    for c in range(4):
                        total = 0.0
                        for d in range(4):
                            total += inverse[m, k, c, d] * right[d]
                        out[c // 2, m, i, c % 2, k, j] = total
    return out


def section_gram(
    signals: SectionSignals, sections: SectionArrays, values: Array, states: Array, driven: Array
) -> tuple[Array, Array]:
    """Gram matrix of the signals of derivatives, (n, n), and sums with the states, (order, n).

    ``values``: those signals, (N, n); ``states``, (N, order); ``driven``: sums of their products
    with the signals that drive sections, (n, driving).
    """
    layout, drives = signals.layout, signals.of_drives
    count, split = layout.sections, 2 * layout.sections * layout.drives
    poles = sections.sigma, sections.coupling, sections.back
    F = np.array([[sections.sigma, sections.back], [sections.coupling, sections.sigma]])
    by_sections = np.einsum("abm,cdk->mkacbd", F, F).reshape(count, count, 4, 4)
    inverse = np.linalg.inv(np.eye(4) - by_sections)
    # How responses add up to the states of their section.
    b1, b2 = sections.b1, sections.b2
    adding = np.array([[b1, b2], [b2, sections.ratio[:, None] * b1]])

    def parts(rows: Array) -> tuple[NDArray, NDArray]:
        responses, derivatives = np.split(rows, [split])
        shape = 2, count, layout.drives, -1
        return responses.reshape(shape), derivatives.reshape(2, count, 2, -1)

    def of_drives(products: NDArray) -> NDArray:
        sources = np.zeros((2, count, layout.drives, *products.shape[:-1]))
        sources[0, :, : signals.driving] = np.moveaxis(products, -1, 0)
        return sources

    def summed(v: NDArray) -> NDArray:
        return np.einsum("acmd,cmd...->am...", adding, v)

    def ends(i: int, j: int) -> NDArray:
        after = np.tensordot(ended[i], ended[j], (-1, -1))
        return np.tensordot(begun[i], begun[j], (-1, -1)) - after

    firsts, lasts = signals.bounds[:-1], signals.bounds[1:] - 1
    padded = np.zeros((2 * count, len(lasts)))
    padded[: layout.order] = states[lasts].T
    (responses, derivatives), begun = parts(driven), parts(values[firsts].T)
    ended = [np.einsum("abm,bm...->am...", F, last) for last in parts(values[lasts].T)]
    ended[0] += of_drives(drives[lasts])
    ended[1] += _of_states(padded.reshape(count, 2, -1).swapaxes(0, 1))

    # Of responses v, then of derivatives d, and of both with the states x.
    z_v, power = of_drives(responses), of_drives(drives.T @ drives)
    v_v = stein(*poles, inverse, z_v, z_v, of_drives(power) + ends(0, 0))
    x_v = summed(v_v)
    z_z = of_drives(np.moveaxis(_of_states(summed(responses)), -1, 0).T)
    v_d = stein(*poles, inverse, of_drives(derivatives), _of_states(x_v), z_z + ends(0, 1))
    x_d = summed(v_d)
    x_x = summed(np.moveaxis(x_v, (0, 1), (-2, -1)))
    z_z = _of_states(np.moveaxis(_of_states(x_x), (0, 1, 2), (2, 3, 4)))
    z_d = _of_states(x_d)
    d_d = stein(*poles, inverse, z_d, z_d, z_z + ends(1, 1))
    across = v_d.reshape(split, -1)
    gram = np.block([[v_v.reshape(split, split), across], [across.T, d_d.reshape(4 * count, -1)]])
    with_states = np.concatenate([x_v.reshape(2, count, -1), x_d.reshape(2, count, -1)], axis=2)
    return gram, with_states.swapaxes(0, 1).reshape(2 * count, -1)[: layout.order]


def _of_states(x: NDArray) -> NDArray:
    """States as sources of derivatives by sigma, and by delta."""
    return np.einsum("cka,am...->cmk...", STATES_DRIVE, x)
