// Where a recorder gets what a Tick does not say: the renderers, the mixer, the mapping.
#pragma once

#include <vector>

#include "device/record/renderer_tap.h"
#include "device/servo/servo.h"

namespace palpate::device {

class TickSource {
 public:
  TickSource() = default;
  TickSource(const TickSource&) = delete;
  TickSource& operator=(const TickSource&) = delete;
  virtual ~TickSource() = default;

  /// In the servo thread, right after the tick. `out` holds already what `tick` says; tracks, hip_mm and
  /// what the mixer did are to be filled in. The calls of its tracks must stay until recorded().
  virtual void fill(const Tick& tick, RecordedTick& out) noexcept = 0;
  /// The tick was taken: the next one begins.
  virtual void recorded() noexcept = 0;
};

/// Renderers without a mixer: the first one is felt. Refers to the taps.
class TapSource final : public TickSource {
 public:
  /// `taps`: in the order of the recording's table; at most RecordedTick::kMostTracks, the others are not
  /// recorded.
  TapSource(std::vector<RendererTap*> taps, const geometry::RigidTransform& world_from_device)
      : taps_(std::move(taps)), world_from_device_(world_from_device) {
    if (taps_.size() > RecordedTick::kMostTracks) taps_.resize(RecordedTick::kMostTracks);
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
