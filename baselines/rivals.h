// The rivals, one function each, for the registry.
#pragma once

#include <palpate/registry.h>

namespace palpate::baselines {

/// `mesh-godobject`: Zilles and Salisbury (1995) on a triangle mesh: god object in facet_walk.h, entries in
/// segment_index.h, contact in mesh_probe.h. make() gives a MeshHolder.
[[nodiscard]] render::RendererInfo mesh_godobject_info();
/// `mesh-proxy`: Ruspini's sphere proxy (1997) on a triangle mesh, with facets from Embree; see
/// sphere_probe.h. One sphere for the whole scene. make() gives a MeshHolder.
[[nodiscard]] render::RendererInfo mesh_proxy_info();
/// `cloud-vertices`: chapter 3's surface (a plane at every point) made right: touching boxes for detection,
/// points for rest, a sided contact state that cannot stick, bounded work. The predecessor of the triangles
/// of `cloud`.
[[nodiscard]] render::RendererInfo cloud_vertices_info();
/// `mls-penalty` (Lee and Kim 2007, the thesis's [52]): a hierarchy of swept spheres finds points near the
/// HIP, a moving-least-squares surface is built through them in the frame, and the force is k x depth along
/// its normal. The projection is Alexa and Adamson's; the paper's text is not public.
[[nodiscard]] render::RendererInfo mls_penalty_info();
/// `mls-proxy` (Leeper, Chan and Salisbury 2012): a proxy on an implicit surface of the points (metaballs, or
/// moving least squares over oriented points) while the HIP is inside. Constants of the authors' public
/// program.
[[nodiscard]] render::RendererInfo mls_proxy_info();
/// `penalty-grid`: the patent of table 11 ([75]) as described in section 2.2.3 (its text is unknown to us):
/// the HIP's voxel, distances to its points, contact below a threshold, a penalty force. No neighbouring
/// voxels, no inside test. The force law is ours: k (threshold - distance), away from the nearest point.
[[nodiscard]] render::RendererInfo penalty_grid_info();
/// `sdf-godobject`: a god object on the zero set of a narrow-band signed distance grid of the points.
[[nodiscard]] render::RendererInfo sdf_godobject_info();
/// `sphere-proxy`: the bag of spheres of the open haptics library (CHAI3D 3.3) for point clouds: each point
/// stops a spherical proxy's centre at its radius, and the proxy moves as in Ruspini et al. 1997. Ours
/// reaches its rest within the frame, without that library's epsilons (sphere_proxy.h), so it neither lags
/// nor jams.
[[nodiscard]] render::RendererInfo sphere_proxy_info();
/// `stream-proxy`: Ryden and Chizeck's proxy for streaming points (IEEE Transactions on Haptics 2013), from
/// public descriptions: needs only a grid, and is steered by the numbers and mean direction of points within
/// three shells r1 < r2 < r3. Follows moving points (MoveQueue).
[[nodiscard]] render::RendererInfo stream_proxy_info();
/// `variable-proxy`: a spherical proxy whose radius follows the local point density.
[[nodiscard]] render::RendererInfo variable_proxy_info();
/// `vector-field`: the first response of section 2.2.2, a force looked up by position. Prepared from
/// distances to the points' planes on a voxel grid, in bricks near the surface. Shows the cost of ignoring
/// where the HIP came from.
[[nodiscard]] render::RendererInfo vector_field_info();
/// `vgraph`: the thesis's [51] (sections 2.2.3 and 3.6.3): a graph of vertices leads greedily to the one
/// nearest to the HIP, then the HIP's segment is tested against its triangles. The response is ours (the
/// thesis says "presumably constraint-based"): Zilles and Salisbury's god object, minimised over the
/// triangles from the one entered (facet_walk.h).
[[nodiscard]] render::RendererInfo vgraph_info();

}  // namespace palpate::baselines
