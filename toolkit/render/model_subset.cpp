#include "toolkit/render/model_subset.h"

#include <memory>
#include <utility>

#include "toolkit/cloud/cloud_subset.h"

namespace palpate::render {

geometry::Aabb box_of(const std::vector<ModelInput>& models) {
  geometry::Aabb box;
  constexpr int kCorners = 8;
  for (const ModelInput& model : models) {
    const geometry::Aabb own = model.cloud->box_mm();
    for (int corner = 0; corner < kCorners; ++corner) {
      Vec3 at = own.low_mm;
      for (int axis = 0; axis < 3; ++axis)
        if ((corner >> axis & 1) != 0) at[axis] = own.high_mm[axis];
      box.add(model.world_from_model * at);
    }
  }
  return box;
}

ModelInput subset_of(const ModelInput& model, std::span<const std::uint32_t> of,
                     const std::optional<cloud::ScanRaster>& raster) {
  ModelInput part = model;
  auto points = std::make_shared<cloud::Cloud>(cloud::subset_of(*model.cloud, of));
  points->raster = raster;
  part.cloud = std::move(points);
  part.original_mesh = nullptr;
  if (const surface::PointProperties* p = model.surface.per_point.get())
    part.surface.per_point = std::make_shared<const surface::PointProperties>(surface::PointProperties{
        cloud::taken(p->stiffness_n_per_mm, of), cloud::taken(p->static_friction, of),
        cloud::taken(p->dynamic_friction, of), cloud::taken(p->deformation, of)});
  return part;
}

}  // namespace palpate::render
