// A renderer around another one, for what changes a part of what that does.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/renderer.h"

namespace palpate::render {

/// Passes everything on but step(). Owns the inner renderer, or refers to one that outlives it.
class WrappedRenderer : public HapticRenderer {
 public:
  explicit WrappedRenderer(HapticRenderer& inner) noexcept : inner_(inner) {}
  /// Takes it; never null.
  explicit WrappedRenderer(std::unique_ptr<HapticRenderer> inner) noexcept
      : owned_(std::move(inner)), inner_(*owned_) {}

  [[nodiscard]] Result<Decisions> decide(const SceneInput& scene,
                                         const PrepareContext& context) const override {
    return inner_.decide(scene, context);
  }
  [[nodiscard]] Result<PrepareReport> prepare(const SceneInput& scene,
                                              const PrepareContext& context) override {
    return inner_.prepare(scene, context);
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept override { inner_.restart(hip_mm, t_s); }
  void let_go(const Vec3& hip_mm) noexcept override { inner_.let_go(hip_mm); }
  [[nodiscard]] FrameCounters counters() const noexcept override { return inner_.counters(); }
  [[nodiscard]] Description describe() const override { return inner_.describe(); }

 protected:
  [[nodiscard]] HapticRenderer& inner() noexcept { return inner_; }

 private:
  std::unique_ptr<HapticRenderer> owned_;
  HapticRenderer& inner_;
};

}  // namespace palpate::render
