// The recording of a live session: every renderer on the hand, and what the mixer did with them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device/live/mixer.h"
#include "device/record/recorder.h"
#include "device/record/tick_source.h"
#include "experiments/live/changes.h"

namespace palpate::experiments {

/// Nothing of it is used in a session that is not recorded. tracked() belongs to one thread at a time: before
/// the session to who prepares it, then to the worker. fill() and recorded() are the servo thread's.
class LiveRecording final : public device::TickSource {
 public:
  /// A renderer as the mixer is to have it: its calls are noted. In the recording's table under its label, a
  /// later one of the same label as "label (2)". Errors of the file, once it is open.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> tracked(
      std::unique_ptr<render::HapticRenderer> renderer, const LiveSetting& setting, bool passivity_apart,
      const Clock& clock);

  /// The file, with what was tracked until now. Every renderer of the mixer must have come from tracked().
  [[nodiscard]] Status open(const std::string& path, bool replace, device::RecordingHeader header,
                            const device::Mixer& mixer);
  /// Nothing was felt: the file goes away.
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

/// What RecordedTick::decision means in a live session.
[[nodiscard]] std::vector<std::string> live_decisions();

}  // namespace palpate::experiments
