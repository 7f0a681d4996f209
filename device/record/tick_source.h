// Supplies a recorder with data that a Tick lacks: renderers, mixer, mapping.
#pragma once

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/servo.h>
#include "device/record/recording_header.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {

// Records the calls of a wrapped renderer, unnoticed by its callers (servo, bring-up, mixer).

/// Keeps a reference to the clock, and to the renderer unless it owns it. For the frame thread. Two clock
/// readings a step; no allocation.
class RendererTap final : public render::WrappedRenderer {
 public:
  RendererTap(render::HapticRenderer& inner, const Clock& clock) noexcept
      : WrappedRenderer(inner), clock_(clock) {}
  /// Takes ownership; never null. `index`: in the recording's renderer table.
  RendererTap(std::unique_ptr<render::HapticRenderer> inner, const Clock& clock,
              std::uint16_t index = 0) noexcept
      : WrappedRenderer(std::move(inner)), clock_(clock), index_(index) {}
  [[nodiscard]] std::uint16_t index() const noexcept { return index_; }

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    // A restart discards earlier calls.
    begin_tick();
    note({RendererCall::Kind::kRestart, hip_mm, t_s});
    inner().restart(hip_mm, t_s);
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    note({RendererCall::Kind::kReleaseContact, hip_mm, 0.0});
    inner().release_contact(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    note({RendererCall::Kind::kStep, hip_mm, t_s});
    const std::int64_t begun_ns = clock_.now_ns();
    frame_ = inner().step(hip_mm, t_s);
    step_ns_ += clock_.now_ns() - begun_ns;
    stepped_ = true;
    return frame_;
  }

  /// Gives the calls since begin_tick(), valid until the next one. `renderer` stays as set by the caller.
  void fill(RecordedTrack& track) const noexcept {
    track.stepped = stepped_;
    track.calls_lost = lost_;
    track.frame = stepped_ ? frame_ : render::Frame{};
    track.step_ns = step_ns_;
    track.calls = {calls_.data(), count_};
  }
  /// Call after a tick was recorded; later calls belong to the next tick.
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
  std::array<RendererCall, kMaxCalls> calls_{};
  std::size_t count_ = 0;
  bool stepped_ = false, lost_ = false;
  render::Frame frame_;
  std::int64_t step_ns_ = 0;
};

class TickSource {
 public:
  TickSource() = default;
  TickSource(const TickSource&) = delete;
  TickSource& operator=(const TickSource&) = delete;
  virtual ~TickSource() = default;

  /// Called in the servo thread right after the tick. `out` holds the data of `tick`; fill in tracks, hip_mm
  /// and the mixer's state. The tracks' calls must stay valid until recorded().
  virtual void fill(const Tick& tick, RecordedTick& out) noexcept = 0;
  /// The tick was recorded; the next one begins.
  virtual void recorded() noexcept = 0;
};

/// Renderers without a mixer: the first is felt. Keeps references to the taps.
class TapSource final : public TickSource {
 public:
  /// `taps` in the order of the recording's table; those beyond RecordedTick::kMaxTracks are not recorded.
  TapSource(std::vector<RendererTap*> taps, const geometry::RigidTransform& world_from_device)
      : taps_(std::move(taps)), world_from_device_(world_from_device) {
    if (taps_.size() > RecordedTick::kMaxTracks) taps_.resize(RecordedTick::kMaxTracks);
  }
  void fill(const Tick& tick, RecordedTick& out) noexcept override {
    out.hip_mm = world_from_device_ * tick.state.position_mm;
    out.track_count = static_cast<std::uint8_t>(taps_.size());
    for (std::size_t i = 0; i < taps_.size(); ++i) {
      out.tracks[i].renderer = static_cast<std::uint16_t>(i);
      taps_[i]->fill(out.tracks[i]);
    }
  }
  void recorded() noexcept override {
    for (RendererTap* tap : taps_) tap->begin_tick();
  }

 private:
  std::vector<RendererTap*> taps_;
  geometry::RigidTransform world_from_device_;
};

}  // namespace palpate::device
