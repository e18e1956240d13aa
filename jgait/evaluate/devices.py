"""A cohort on more than one device or process of JAX."""

from collections.abc import Callable

import jax
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PyTree


def checked_mesh(mesh: Mesh | None) -> Mesh | None:
    """The devices of a mesh that belong to this process.

    Raises:
        ValueError: if the mesh has more than one axis, or no device of this process.
    """
    if mesh is None:
        return None
    if not isinstance(mesh, Mesh) or len(mesh.axis_names) != 1:
        raise ValueError(f"mesh must be a jax.sharding.Mesh of one axis; got {mesh!r}")
    local = mesh.local_mesh if mesh.is_multi_process else mesh
    if not local.size:
        raise ValueError("mesh has no device of this process")
    return local


def sharded(mapped: Callable[..., PyTree], mesh: Mesh) -> Callable[..., PyTree]:
    """A function over batches, each batch divided among the devices of a mesh; devices exchange no data."""
    along = PartitionSpec(mesh.axis_names[0])
    # The carry of a scan begins with constants, equal on all devices, and ends different: this is intended.
    return jax.shard_map(mapped, mesh=mesh, in_specs=along, out_specs=along, check_vma=False)
