#include "toolkit/stream/simulated_scene.h"

#include <algorithm>
#include <utility>

#include "toolkit/core/messages.h"

namespace palpate::stream {

Result<std::unique_ptr<SimulatedScene>> SimulatedScene::make(render::SceneInput input) {
  std::unique_ptr<SimulatedScene> scene(new SimulatedScene(std::move(input)));
  for (const render::ModelInput& input_model : scene->scene_.models) {
    Model model;
    if (input_model.analytic != nullptr) {
      model.box_mm = input_model.analytic->box_mm();
    } else if (input_model.original_mesh != nullptr && !input_model.original_mesh->empty()) {
      for (const Vec3& vertex : input_model.original_mesh->vertices_mm) model.box_mm.add(vertex);
      model.faces = std::make_unique<geometry::MeshRayCaster>(*input_model.original_mesh);
    } else {
      return Error{"a simulated camera cannot see the model " + shown(input_model.name),
                   "use generated models, or files with faces"};
    }
    scene->models_.push_back(std::move(model));
  }
  if (scene->scene_.simulation != nullptr) scene->scene_.simulation->reset();
  scene->go_to(0.0);
  return scene;
}

void SimulatedScene::go_to(double t_s) noexcept {
  if (scene_.simulation != nullptr) {
    if (t_s < now_s_) scene_.simulation->reset();
    scene_.simulation->advance(t_s);
  }
  now_s_ = t_s;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const render::ModelInput& input = scene_.models[i];
    models_[i].world_from_model =
        input.motion != nullptr ? input.motion->newest().at(t_s) : input.world_from_model;
    models_[i].model_from_world = models_[i].world_from_model.inverse();
  }
}

std::optional<SceneHit> SimulatedScene::first_hit(const Vec3& origin_mm,
                                                  const Vec3& direction) const noexcept {
  const double length = direction.norm();
  std::optional<SceneHit> first;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const Model& model = models_[i];
    const Vec3 from = model.model_from_world * origin_mm;
    // To the far side of the sphere about the box: a hit before it ends the ray there.
    const double reach =
        ((from - model.box_mm.centre_mm()).norm() + 0.5 * model.box_mm.extent_mm().norm()) / length;
    const double end = first ? std::min(first->along, reach) : reach;
    const Vec3 to = from + end * model.model_from_world.rotate(direction);
    const std::optional<geometry::SurfacePoint> hit = model.faces != nullptr
                                                          ? model.faces->first_hit(from, to)
                                                          : scene_.models[i].analytic->first_entry(from, to);
    if (!hit) continue;
    const double along = (hit->point_mm - from).norm() / length;
    if (!first || along < first->along) first = {along, model.world_from_model.rotate(hit->normal)};
  }
  return first;
}

}  // namespace palpate::stream
