#include "toolkit/render/renderer.h"

#include <fmt/format.h>

namespace palpate::render {

Result<const ModelInput*> only_model(const SceneInput& scene) {
  if (scene.models.size() != 1)
    return Error{fmt::format("this renderer takes one model, the scene has {}", scene.models.size()),
                 "keep one [[model]] in the scene, or take the renderer 'cloud'",
                 {},
                 0};
  return &scene.models.front();
}

}  // namespace palpate::render
