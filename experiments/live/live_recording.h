// Records a live session: every renderer's frames and the mixer's decisions.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device/live/mixer.h"
#include "device/record/recorder.h"
#include "device/record/tick_source.h"
#include "experiments/live/changes.h"

namespace palpate::experiments {

/// Unused in sessions without a recording. tracked() is for one thread at a time: first the preparing thread,
/// then the worker. fill() and recorded() are for the servo thread.
class LiveRecording final : public device::TickSource {
 public:
  /// Wraps a renderer for the mixer and records its calls. Its table entry has its label; later ones of the
  /// same label become "label (2)". Errors: the file's, once open.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> tracked(
      std::unique_ptr<render::HapticRenderer> renderer, const LiveSetting& setting, bool passivity_apart,
      const Clock& clock);

  /// Creates the file with the renderers tracked so far. Every renderer of the mixer must come from
  /// tracked().
  [[nodiscard]] Status open(const std::string& path, bool replace, device::RecordingHeader header,
                            const device::Mixer& mixer);
  /// Removes the file of a session without any tick.
  void discard(const std::string& path);
  /// Null before open().
  [[nodiscard]] device::Recorder* recorder() noexcept { return recorder_.get(); }

  void fill(const device::Tick& tick, device::RecordedTick& out) noexcept override;
  void recorded() noexcept override;

 private:
  const device::Mixer* mixer_ = nullptr;
  std::vector<device::RecordedRenderer> table_;
  std::unique_ptr<device::Recorder> recorder_;
};

/// Meanings of RecordedTick::decision in a live session.
[[nodiscard]] std::vector<std::string> live_decisions();

}  // namespace palpate::experiments
