// A scene with one of its stages left out, for each stage that it has: what a surface does, what moves, what
// is controlled, how the points are cleaned, what the renderer does beyond its defaults.
#pragma once

#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "toolkit/render/decision.h"
#include "toolkit/render/registry.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

struct Variant {
  std::string stage;    ///< that is left out: "friction", "model 2, bunny"; empty: none is
  std::string instead;  ///< what there is in its place, a few words
  scene::LoadedScene scene;
  RendererRequest request;
};

/// Of a scene of more models only the first is taken alone: leaving each out in turn would tell little more.
inline constexpr std::size_t kMostModelsInTurn = 8;

/// The whole scene, then one variant for each stage that the scene has or the renderer adds. `decided`: by
/// the renderer for the scene. `uncleaned`: the scene loaded without its steps of cleaning; null where it has
/// none. The same arguments give the same list, so that another process can make it again.
[[nodiscard]] std::vector<Variant> variants_of(const scene::LoadedScene& scene,
                                               const RendererRequest& request,
                                               const render::Registry& registry,
                                               const render::Decisions& decided,
                                               const scene::LoadedScene* uncleaned);

}  // namespace palpate::experiments
