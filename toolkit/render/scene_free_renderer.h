// A renderer that is made of no scene: of a formula, a script, or a fault to be looked at.
#pragma once

#include "toolkit/render/renderer.h"

namespace palpate::render {

/// Scenes decide and prepare nothing, nothing is kept from frame to frame, and nothing is counted. What else
/// it does is the derived class's to say.
class SceneFreeRenderer : public HapticRenderer {
 public:
  [[nodiscard]] Result<Decisions> decide(const SceneInput& /*scene*/,
                                         const PrepareContext& /*context*/) const override {
    return Decisions{};
  }
  [[nodiscard]] Result<PrepareReport> prepare(const SceneInput& /*scene*/,
                                              const PrepareContext& /*context*/) override {
    return PrepareReport{};
  }
  void restart(const Vec3& /*hip_mm*/, double /*t_s*/) noexcept override {}
  void let_go(const Vec3& /*hip_mm*/) noexcept override {}
  [[nodiscard]] FrameCounters counters() const noexcept override { return {}; }
};

}  // namespace palpate::render
