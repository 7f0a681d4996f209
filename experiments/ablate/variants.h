// Variants of a scene with one stage left out: surface effects, motion, control, cleaning, or renderer
// options.
#pragma once

#include <string>
#include <vector>

#include <palpate/decision.h>
#include <palpate/registry.h>
#include <palpate/scene.h>
#include "experiments/run/arguments.h"

namespace palpate::experiments {

struct Variant {
  std::string stage;    ///< the missing stage: "friction", "model 2, bunny"; empty: none
  std::string instead;  ///< its replacement, a few words
  scene::LoadedScene scene;
  RendererRequest request;
};

/// Scenes of more models only keep the first: leaving each out would tell little more.
inline constexpr std::size_t kMostModelsInTurn = 8;

/// The whole scene, then a variant for each stage of the scene or the renderer. `decided`: the renderer's
/// decisions for the scene. `uncleaned`: the scene without cleaning steps; null if it has none.
/// Deterministic, so another process can recreate the list.
[[nodiscard]] std::vector<Variant> variants_of(const scene::LoadedScene& scene,
                                               const RendererRequest& request,
                                               const render::Registry& registry,
                                               const render::Decisions& decided,
                                               const scene::LoadedScene* uncleaned);

}  // namespace palpate::experiments
