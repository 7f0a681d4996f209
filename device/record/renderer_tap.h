// Put around a renderer that is recorded: passes every call on and notes it for the tick. Whoever calls the
// renderer (servo, bring-up, mixer) knows nothing of it.
#pragma once

#include <array>
#include <memory>
#include <utility>

#include "device/record/recorded_tick.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {

/// Refers to the clock, and to the renderer unless it is given it. One thread, that of the frames. Costs two
/// readings of the clock a step, and nothing is allocated.
class RendererTap final : public render::WrappedRenderer {
 public:
  RendererTap(render::HapticRenderer& inner, const Clock& clock) noexcept
      : WrappedRenderer(inner), clock_(clock) {}
  /// Takes it; never null. `index`: its own in the recording's table.
  RendererTap(std::unique_ptr<render::HapticRenderer> inner, const Clock& clock,
              std::uint16_t index = 0) noexcept
      : WrappedRenderer(std::move(inner)), clock_(clock), index_(index) {}
  [[nodiscard]] std::uint16_t index() const noexcept { return index_; }

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    // What was done before is undone by it.
    begin_tick();
    note({RendererCall::Kind::kRestart, hip_mm, t_s});
    inner().restart(hip_mm, t_s);
  }
  void let_go(const Vec3& hip_mm) noexcept override {
    note({RendererCall::Kind::kLetGo, hip_mm, 0.0});
    inner().let_go(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    note({RendererCall::Kind::kStep, hip_mm, t_s});
    const std::int64_t begun_ns = clock_.now_ns();
    frame_ = inner().step(hip_mm, t_s);
    step_ns_ += clock_.now_ns() - begun_ns;
    stepped_ = true;
    return frame_;
  }

  /// What was called since the last begin_tick(); the calls stay until the next one. `renderer` stays as the
  /// caller has set it.
  void fill(RecordedTrack& track) const noexcept {
    track.stepped = stepped_;
    track.calls_lost = lost_;
    track.frame = stepped_ ? frame_ : render::Frame{};
    track.step_ns = step_ns_;
    track.calls = {calls_.data(), count_};
  }
  /// After the tick was recorded: the next call belongs to the next tick.
  void begin_tick() noexcept {
    count_ = 0;
    step_ns_ = 0;
    stepped_ = lost_ = false;
  }

 private:
  void note(const RendererCall& call) noexcept {
    if (count_ < calls_.size())
      calls_[count_++] = call;
    else
      lost_ = true;
  }

  const Clock& clock_;
  std::uint16_t index_ = 0;
  std::array<RendererCall, kMostCalls> calls_{};
  std::size_t count_ = 0;
  bool stepped_ = false, lost_ = false;
  render::Frame frame_;
  std::int64_t step_ns_ = 0;
};

}  // namespace palpate::device
