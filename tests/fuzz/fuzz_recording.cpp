// Fuzzes recordings: an Error that names the file, or valid ticks, in bounded memory.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "device/record/recording.h"
#include "tests/fuzz/must.h"

namespace {

using palpate::must;

void check(const palpate::device::Recording& recording, const palpate::device::RecordedTick& tick) {
  must(std::isfinite(tick.t_s));
  must(tick.track_count <= palpate::device::RecordedTick::kMaxTracks);
  must(tick.weight >= 0.0 && tick.weight <= 1.0);
  must(tick.decision < recording.header().decisions.size());
  must(tick.state.raw.size <= palpate::device::RawPacket::kMost);
  for (const palpate::device::RecordedTrack& track : tick.tracked()) {
    must(track.renderer < recording.renderers().size());
    must(track.calls.size() <= palpate::device::kMaxCalls);
    must(track.stepped || !track.frame.contact);
  }
}

void read_all(const std::uint8_t* data, std::size_t size, bool skip_damaged) {
  std::size_t at = 0;
  palpate::device::ReadRecordingOptions options;
  options.skip_damaged = skip_damaged;
  auto recording = palpate::device::Recording::open(
      [&](std::span<std::byte> out) -> palpate::Result<std::size_t> {
        const std::size_t n = std::min(out.size(), size - at);
        std::copy_n(reinterpret_cast<const std::byte*>(data) + at, n, out.begin());
        at += n;
        return n;
      },
      "fuzzed.palrec", options);
  if (!recording) {
    must(!recording.error().what.empty() && recording.error().file == "fuzzed.palrec");
    return;
  }
  palpate::device::RecordedTick tick;
  for (;;) {
    const auto more = recording->next(tick);
    if (!more) {
      must(!more.error().what.empty() && more.error().file == "fuzzed.palrec");
      return;
    }
    if (!*more) break;
    check(*recording, tick);
  }
  must(recording->end().torn_at + recording->end().torn_bytes <= size);
  static_cast<void>(recording->end().warnings());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_all(data, size, false);
  read_all(data, size, true);
  return 0;
}
