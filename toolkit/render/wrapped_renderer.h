// Base classes for a renderer around another, and for stubs.
#pragma once

#include <palpate/renderer.h>
#include <memory>
#include <utility>

namespace palpate::render {

/// Forwards everything except step(). Owns the inner renderer, or refers to one that outlives it.
class WrappedRenderer : public HapticRenderer {
 public:
  explicit WrappedRenderer(HapticRenderer& inner) noexcept : inner_(inner) {}
  /// Takes ownership; never null.
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
  void release_contact(const Vec3& hip_mm) noexcept override { inner_.release_contact(hip_mm); }
  [[nodiscard]] FrameCounters counters() const noexcept override { return inner_.counters(); }
  [[nodiscard]] Description describe() const override { return inner_.describe(); }

 protected:
  [[nodiscard]] HapticRenderer& inner() noexcept { return inner_; }

 private:
  std::unique_ptr<HapticRenderer> owned_;
  HapticRenderer& inner_;
};

/// A renderer that decides, prepares, remembers and counts nothing. Derived classes define step().
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
  void release_contact(const Vec3& /*hip_mm*/) noexcept override {}
  [[nodiscard]] FrameCounters counters() const noexcept override { return {}; }
};

}  // namespace palpate::render
