// Ticks to be recorded, and recordings in memory.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "device/record/recorder.h"
#include "device/record/recording.h"
#include "toolkit/core/random.h"

namespace palpate::device {

/// What is appended, and failures on request.
struct MemoryDisk {
  std::vector<std::byte> bytes;
  std::size_t room = std::size_t{1} << 40;  ///< appending beyond it fails
  int slow_ms = 0;                          ///< every append takes so long
  bool broken = false;
  std::mutex mutex;

  [[nodiscard]] std::vector<std::byte> copy() {
    const std::lock_guard lock(mutex);
    return bytes;
  }
};

class MemoryFile final : public RecordingFile {
 public:
  explicit MemoryFile(MemoryDisk& disk) : disk_(disk) {}
  Status append(std::span<const std::byte> bytes) override;
  Status flush(Flush /*how*/) override { return Done{}; }
  const std::string& path() const noexcept override { return path_; }

 private:
  MemoryDisk& disk_;
  std::string path_ = "memory.palrec";
};

/// Ticks at 1 kHz with everything in them that a tick may hold.
class RandomTicks final : public TickSource {
 public:
  explicit RandomTicks(std::uint64_t seed, std::size_t tracks = 2, bool keeps_all = true)
      : keeps(keeps_all), random_(seed), tracks_(tracks) {}
  [[nodiscard]] Tick next();
  void fill(const Tick& tick, RecordedTick& out) noexcept override;
  void recorded() noexcept override {}
  /// As they were given to the recorder; calls are kept as well. Only of a source that keeps.
  std::vector<RecordedTick> given;
  std::vector<std::unique_ptr<std::array<std::vector<RendererCall>, RecordedTick::kMaxTracks>>> kept;
  bool keeps;

 private:
  [[nodiscard]] Vec3 anywhere();
  Random random_;
  std::size_t tracks_;
  std::int64_t t_ns_ = 0;
  std::array<std::array<RendererCall, kMaxCalls>, RecordedTick::kMaxTracks> calls_{};
};

[[nodiscard]] inline RecordingHeader some_header() {
  RecordingHeader header;
  header.program = "palpate 0.1.0";
  header.scene = "sinusoid";
  header.scene_text = "force_limit_n = 3.3\n";
  header.scene_hash = "0123456789abcdef";
  header.device = "sim:omni";
  header.limits.force_max_n = 3.3;
  header.limits.workspace_mm = {Vec3{-80, -60, -35}, Vec3{80, 60, 35}};
  header.world_from_device.translation_mm = Vec3{1.0, 2.0, 1.0 / 3.0};
  header.mapping = "one to one";
  header.scheduling = "virtual clock";
  header.started_utc = "2026-01-31T12:00:00Z";
  header.clock_start_ns = 12345;
  header.decisions = {"none", "swap", "fade", "refused"};
  return header;
}

[[nodiscard]] Result<Recording> open_bytes(std::vector<std::byte> bytes,
                                           const ReadRecordingOptions& options = {});

/// Records `ticks` ticks of the source into the disk. What finish() says.
[[nodiscard]] Status record(MemoryDisk& disk, RandomTicks& source, int ticks,
                            const RecorderOptions& options = {});

/// The first thing that differs, or nothing.
[[nodiscard]] std::string difference(const RecordedTick& a, const RecordedTick& b);

}  // namespace palpate::device
