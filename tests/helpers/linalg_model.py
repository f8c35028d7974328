"""Model problems of the linear-algebra tests: a poroelastic fluid block and an elastic one on
structured simplices, P1.
"""

import itertools
import math

import numpy as np


def simplex_grid(n, dim, length=10.0):
    """Return the points, (N, dim), and cells, (E, dim + 1), of a cube cut into n^dim dim! simplices
    (Kuhn).
    """
    axis = np.linspace(0.0, length, n + 1)
    X = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), -1).reshape(-1, dim)
    index = np.arange(len(X)).reshape((n + 1,) * dim)
    cells = []
    for path in itertools.permutations(range(dim)):
        corners = np.cumsum([np.zeros(dim, int), *np.eye(dim, dtype=int)[list(path)]], axis=0)
        cells.append(
            np.stack([index[tuple(slice(o, n + o) for o in c)].ravel() for c in corners], axis=1)
        )
    return X, np.concatenate(cells)


def gradients(X, cells):
    """Return the shape gradients, (E, A, d), and volumes, (E,)."""
    dim = X.shape[1]
    J = np.stack([X[cells[:, k + 1]] - X[cells[:, 0]] for k in range(dim)], axis=2)
    rest = np.linalg.inv(J)
    return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1), np.abs(
        np.linalg.det(J)
    ) / math.factorial(dim)


class Block:
    """Nodes in contiguous slabs per rank; every rank holds the elements that touch its nodes."""

    def __init__(self, comm, dim, n, block_size, empty_last_rank=False):
        self.comm = comm
        self.dim = dim
        self.block_size = block_size
        self.X, self.all_cells = simplex_grid(n, dim)
        sharing = comm.size - 1 if empty_last_rank and comm.size > 1 else comm.size
        bounds = np.linspace(0, len(self.X), sharing + 1).astype(int)
        bounds = [*bounds, *[len(self.X)] * (comm.size - sharing)]
        self.first_node = bounds[comm.rank]
        last = bounds[comm.rank + 1]
        self.n_owned_nodes = last - self.first_node
        self.X_owned = self.X[self.first_node : last]
        owned = (self.all_cells >= self.first_node) & (self.all_cells < last)
        self.touching = owned.any(axis=1)
        self.all_matrices = self.element_blocks(self.X, self.all_cells)
        sizes = 2 * (self.all_cells.shape[1], block_size)
        self.element_matrices = self.all_matrices[self.touching].reshape(
            self.touching.sum(), *sizes
        )  # (E, A, m, A, m)
        self.constrained = np.zeros((len(self.X), block_size), bool)
        self.constrain(self.constrained, self.X)
        self.constrained = self.constrained.ravel()

    def dofs(self, cells):
        return (cells[:, :, None] * self.block_size + np.arange(self.block_size)).reshape(
            len(cells), cells.shape[1] * self.block_size
        )

    def matrix(self, prefix):
        from porofsi_petsc.linalg.matrix import ElementMatrix

        cells = self.all_cells[self.touching]
        numbering = np.arange(len(self.X))
        constrained = self.constrained.reshape(len(self.X), self.block_size)
        A = ElementMatrix(self.comm, cells, numbering, self.n_owned_nodes, constrained, prefix)
        A.assemble(self.element_matrices)
        return A

    def dense(self):
        """Return the unconstrained matrix, assembled entry by entry."""
        dofs = self.dofs(self.all_cells)
        size = self.X.shape[0] * self.block_size
        matrix = np.zeros((size, size))
        np.add.at(matrix, (dofs[:, :, None], dofs[:, None, :]), self.all_matrices)
        return matrix

    def owned(self, nodal):
        rhs = nodal.ravel() * ~self.constrained
        first = self.first_node * self.block_size
        return rhs[first : first + self.n_owned_nodes * self.block_size]


class FluidBlock(Block):
    """v, p and the auxiliary s of a saturated soil under the trapezoidal rule; drained on top,
    sliding sides.

    drag_number : S dt / rho.
    """

    def __init__(self, comm, dim, n, has_auxiliary, drag_number=30.0, step=1e-3, **distribution):
        self.has_auxiliary = has_auxiliary
        self.step = step
        self.density = 330.0
        self.drag = drag_number * self.density / step
        super().__init__(comm, dim, n, dim + 1 + has_auxiliary, **distribution)

    def constrain(self, mask, X):
        for i in range(self.dim - 1):
            mask[:, i] = (X[:, i] == 0) | (X[:, i] == 10)
        mask[:, self.dim - 1] = X[:, self.dim - 1] == 0
        mask[X[:, self.dim - 1] == 10, self.dim :] = True

    def element_blocks(self, X, cells):
        d = self.dim
        A = self.dim + 1
        porosity = 0.33
        solid = 1340.0
        dN, V = gradients(X, cells)
        mass = (np.ones((A, A)) + np.eye(A)) / ((d + 1) * (d + 2)) * V[:, None, None]
        laplacian = dN @ dN.transpose(0, 2, 1) * V[:, None, None]
        rho = self.density
        c = 2 / self.step
        tau = 1 / np.hypot(2 * rho / self.step, self.drag)
        K = np.zeros((len(cells), A, self.block_size, A, self.block_size))
        for i in range(d):
            K[:, :, i, :, i] = (rho * c + self.drag) * mass
            K[:, :, i, :, d] = porosity * V[:, None, None] / A * dN[:, None, :, i]
            K[:, :, d, :, i] = -K[:, :, i, :, d].transpose(0, 2, 1)
        K[:, :, d, :, d] = tau * porosity**2 * laplacian
        if self.has_auxiliary:
            chi = self.drag / (self.drag + rho * c)
            alpha = 0.67 + chi * porosity
            c_v = c
            c_a = 4 / self.step**2
            B_m = alpha**2 * c_v / 19.5e6 * mass
            K[:, :, d, :, d] += B_m
            K[:, :, d, :, d + 1] = K[:, :, d + 1, :, d] = -B_m
            K[:, :, d + 1, :, d + 1] = (
                B_m + alpha**2 * c_v / (solid * c_a + chi * rho * c * c_v) * laplacian
            )
        return K.reshape(len(cells), A * self.block_size, -1)

    def load(self):
        """Return a smooth force and volume source on the owned rows."""
        nodal = np.zeros((len(self.X), self.block_size))
        cell = (10.0**self.dim) / len(self.X)
        nodal[:, self.dim - 1] = 3300.0 * cell * np.cos(self.X[:, 0])
        nodal[:, self.dim] = 1e-2 * cell * np.sin(self.X[:, -1]) * np.cos(self.X[:, 0])
        return self.owned(nodal)


class ElasticBlock(Block):
    """Small-strain elasticity, clamped at the bottom."""

    def __init__(self, comm, dim, n, constrained=True):
        self.clamped = constrained
        super().__init__(comm, dim, n, dim)

    def constrain(self, mask, X):
        mask[(X[:, -1] == 0) & self.clamped] = True

    def element_blocks(self, X, cells, lam=8.375e6, mu=5.583e6):
        dN, V = gradients(X, cells)
        d = self.dim
        K = lam * np.einsum("eai,ebj->eaibj", dN, dN) + mu * np.einsum("eaj,ebi->eaibj", dN, dN)
        K += mu * np.einsum("eak,ebk,ij->eaibj", dN, dN, np.eye(d))
        return (K * V[:, None, None, None, None]).reshape(len(cells), (d + 1) * d, -1)

    def softened(self):
        """Return the element matrices with a stiffness that varies by a factor of 1000 over the
        block.
        """
        factor = 10.0 ** (-3 * np.sin(self.X[self.all_cells[self.touching]].sum(axis=(1, 2))) ** 2)
        return self.element_matrices * factor[:, None, None, None, None]

    def load(self):
        """Return a force that varies over the block, on the owned rows."""
        return self.owned(1e3 * np.cos(self.X + np.arange(self.dim)))
