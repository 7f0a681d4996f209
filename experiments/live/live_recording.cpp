#include "experiments/live/live_recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include <palpate/result.h>

namespace palpate::experiments {
namespace {

/// Every renderer of a recorded mixer is a RendererTap.
device::RendererTap& tap_of(const device::TrackedFrame& frame) noexcept {
  return static_cast<device::RendererTap&>(*frame.renderer);
}

/// Stores a session's scene changes for one renderer beside its options, under names that no option has; a
/// replay needs them.
device::RecordedRenderer entry_of(const render::HapticRenderer& renderer, const LiveSetting& setting,
                                  bool passivity_apart) {
  device::RecordedRenderer entry{setting.request.label, setting.request.name, {}};
  const Options options = renderer.describe().options;
  entry.options.assign(options.all().begin(), options.all().end());
  if (!setting.request.clean.empty())
    entry.options.emplace_back("scene.clean", fmt::format("{} steps", setting.request.clean.size()));
  if (setting.stiffness_n_per_mm > 0.0)
    entry.options.emplace_back("scene.stiffness", fmt::format("{}", setting.stiffness_n_per_mm));
  if (setting.force_limit_n >= 0.0)
    entry.options.emplace_back("scene.force_limit", fmt::format("{}", setting.force_limit_n));
  if (passivity_apart) entry.options.emplace_back("scene.passivity", "around all");
  return entry;
}

}  // namespace

std::vector<std::string> live_decisions() {
  std::vector<std::string> texts;
  for (int i = 0; i <= static_cast<int>(device::MixDecision::kReplaced); ++i)
    texts.emplace_back(device::decision_text(static_cast<device::MixDecision>(i)));
  texts.front() = "none";
  return texts;
}

Result<std::unique_ptr<render::HapticRenderer>> LiveRecording::tracked(
    std::unique_ptr<render::HapticRenderer> renderer, const LiveSetting& setting, bool passivity_apart,
    const Clock& clock) {
  device::RecordedRenderer entry = entry_of(*renderer, setting, passivity_apart);
  const auto same = std::count_if(table_.begin(), table_.end(), [&](const device::RecordedRenderer& one) {
    return one.label == entry.label || one.label.starts_with(entry.label + " (");
  });
  if (same > 0) entry.label += fmt::format(" ({})", same + 1);
  const auto index = static_cast<std::uint16_t>(table_.size());
  if (recorder_ != nullptr) {
    PALPATE_TRY(recorder_->add_renderer(entry));
  }
  table_.push_back(std::move(entry));
  return std::unique_ptr<render::HapticRenderer>(
      std::make_unique<device::RendererTap>(std::move(renderer), clock, index));
}

Status LiveRecording::open(const std::string& path, bool replace, device::RecordingHeader header,
                           const device::Mixer& mixer) {
  mixer_ = &mixer;
  header.decisions = live_decisions();
  device::RecorderOptions options;
  options.replace = replace;
  PALPATE_ASSIGN(recorder_, device::Recorder::create(path, header, *this, options));
  for (const device::RecordedRenderer& entry : table_) {
    PALPATE_TRY(recorder_->add_renderer(entry));
  }
  return Done{};
}

void LiveRecording::discard(const std::string& path) {
  recorder_.reset();
  std::error_code code;
  std::filesystem::remove(path, code);
}

void LiveRecording::fill(const device::Tick& tick, device::RecordedTick& out) noexcept {
  static_assert(device::kMaxTracked <= device::RecordedTick::kMaxTracks);
  const device::MixedFrame& mixed = mixer_->last();
  out.hip_mm = tick.hip_mm;
  out.track_count = 0;
  out.active = out.to = device::RecordedTick::kNoTrack;
  out.weight = 0.0;
  out.request = 0;
  // A tick without a mixer step (a fault) has no decision.
  const bool stepped = mixed.t_s == tick.t_s;
  out.decision = stepped ? static_cast<std::uint8_t>(mixed.decision) : 0;
  for (std::size_t i = 0; i < mixed.tracked.size(); ++i) {
    const device::TrackedFrame& one = mixed.tracked[i];
    if (!one.present) continue;
    const auto at = static_cast<std::int8_t>(out.track_count);
    device::RendererTap& tap = tap_of(one);
    device::RecordedTrack& track = out.tracks[out.track_count++];
    track.renderer = tap.index();
    tap.fill(track);
    if (i == mixed.felt) {
      out.active = at;
      out.weight = one.weight;
    }
    if (i == mixed.to) out.to = at;
    using Kind = device::SwitchRequest::Kind;
    const bool asked = mixed.request.kind == Kind::kSelect
                           ? one.lane == mixed.request.lane
                           : mixed.request.kind == Kind::kNext && i == mixed.to;
    if (stepped && asked) out.request = static_cast<std::uint8_t>(at + 1);
  }
}

void LiveRecording::recorded() noexcept {
  for (const device::TrackedFrame& one : mixer_->last().tracked)
    if (one.present) tap_of(one).begin_tick();
}

}  // namespace palpate::experiments
