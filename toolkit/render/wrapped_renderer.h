// Base classes of renderers around another, and of stubs. Also the time between frames and the words of a
// work bound.
#pragma once

#include <memory>
#include <string_view>
#include <utility>

#include <palpate/renderer.h>

namespace palpate::render {

/// Measures the time between a renderer's frames from the caller's times.
class FrameTime {
 public:
  void restart(double t_s) noexcept { now_s_ = t_s; }
  /// After release_contact() the past is unknown: the next frame counts no time.
  void release_contact() noexcept { resumed_ = true; }
  /// Takes a frame at `t_s`; returns the time since the last one.
  double advance(double t_s) noexcept {
    const double dt_s = resumed_ ? 0.0 : t_s - now_s_;
    resumed_ = false;
    now_s_ = t_s;
    return dt_s;
  }
  [[nodiscard]] double now_s() const noexcept { return now_s_; }

 private:
  double now_s_ = 0.0;
  bool resumed_ = false;
};

/// No bound is known.
inline constexpr std::string_view kUnbounded = "unbounded";
/// The worst frame within the bound takes longer than 1 ms; its time and cause follow.
inline constexpr std::string_view kLongerThanATick = "longer than a tick at worst: ";

/// True if a renderer declares that a frame may take longer than 1 ms.
[[nodiscard]] constexpr bool may_miss_a_tick(std::string_view work_bound) noexcept {
  return work_bound.starts_with(kUnbounded) || work_bound.starts_with(kLongerThanATick);
}

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
  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept override { return inner_.depth_receiver(); }
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
