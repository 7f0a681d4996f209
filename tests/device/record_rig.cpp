#include "tests/device/record_rig.h"

#include <chrono>
#include <thread>

namespace palpate::device {

Status MemoryFile::append(std::span<const std::byte> bytes) {
  if (disk_.slow_ms > 0) std::this_thread::sleep_for(std::chrono::milliseconds(disk_.slow_ms));
  const std::lock_guard lock(disk_.mutex);
  if (disk_.broken || disk_.bytes.size() + bytes.size() > disk_.room)
    return Error{"cannot write the recording: No space left on device", "free some space on the disk", path_};
  disk_.bytes.insert(disk_.bytes.end(), bytes.begin(), bytes.end());
  return Done{};
}

Vec3 RandomTicks::anywhere() {
  const auto a = [&] { return 200.0 * random_.uniform() - 100.0; };
  const double x = a(), y = a(), z = a();
  return Vec3{x, y, z};
}

Tick RandomTicks::next() {
  Tick tick;
  t_ns_ += 1'000'000;
  tick.t_ns = t_ns_;
  tick.t_s = random_.uniform() < 0.5 ? static_cast<double>(t_ns_) * 1e-9
                                     : static_cast<double>(t_ns_) * 1e-9 + 1e-8 * random_.uniform();
  tick.due_ns = t_ns_ - static_cast<std::int64_t>(1e4 * random_.uniform());
  tick.exchange_ns = static_cast<std::int64_t>(1e5 * random_.uniform());
  tick.rearmed = random_.uniform() < 0.01;
  tick.fault = random_.uniform() < 0.1 ? Fault::kSilence : Fault::kNone;
  tick.state.status = random_.uniform() < 0.8 ? ReadStatus::kFresh : ReadStatus::kNothingNew;
  tick.state.homed = random_.uniform() < 0.9;
  tick.state.buttons = static_cast<std::uint32_t>(16.0 * random_.uniform());
  tick.state.packet_ns = t_ns_ - 1000;
  tick.state.position_mm = anywhere();
  if (random_.uniform() < 0.02) tick.state.position_mm.y() = std::numeric_limits<double>::quiet_NaN();
  tick.state.raw.size = static_cast<std::uint8_t>(65.0 * random_.uniform());
  for (std::size_t i = 0; i < tick.state.raw.size; ++i)
    tick.state.raw.bytes[i] = static_cast<std::uint8_t>(256.0 * random_.uniform());
  if (random_.uniform() < 0.5) tick.sent_n = anywhere();
  return tick;
}

void RandomTicks::fill(const Tick& /*tick*/, RecordedTick& out) noexcept {
  if (random_.uniform() < 0.7) out.hip_mm = anywhere();
  out.track_count = static_cast<std::uint8_t>(tracks_);
  if (random_.uniform() < 0.3 && tracks_ > 1) {
    out.active = 1;
    out.to = 0;
    out.weight = random_.uniform();
    out.request = 1;
    out.decision = 2;
  }
  using Kept = std::array<std::vector<RendererCall>, RecordedTick::kMaxTracks>;
  std::unique_ptr<Kept> keeping = keeps ? std::make_unique<Kept>() : nullptr;
  for (std::size_t i = 0; i < tracks_; ++i) {
    RecordedTrack& track = out.tracks[i];
    track.renderer = static_cast<std::uint16_t>(i);
    track.stepped = random_.uniform() < 0.8;
    track.step_ns = static_cast<std::int64_t>(1e4 * random_.uniform());
    std::size_t count = 0;
    if (random_.uniform() < 0.1) {
      count = static_cast<std::size_t>(40.0 * random_.uniform());
      for (std::size_t c = 0; c < count; ++c) {
        const auto kind = static_cast<RendererCall::Kind>(2.99 * random_.uniform());
        calls_[i][c] = {kind, anywhere(),
                        kind == RendererCall::Kind::kReleaseContact ? 0.0 : random_.uniform()};
      }
    }
    if (track.stepped) {
      calls_[i][count++] = {RendererCall::Kind::kStep, out.hip_mm, out.t_s};
      track.frame.contact = random_.uniform() < 0.5;
      track.frame.model = track.frame.contact ? 3 : -1;
      track.frame.god_object_mm = track.frame.contact ? anywhere() : out.hip_mm;
      if (track.frame.contact) track.frame.force_n = anywhere();
      if (random_.uniform() < 0.05) track.frame.status = render::FrameStatus::kBoundHit;
    }
    track.calls = std::span(calls_[i]).first(count);
    if (keeps) (*keeping)[i].assign(track.calls.begin(), track.calls.end());
  }
  if (!keeps) return;
  given.push_back(out);
  for (std::size_t i = 0; i < tracks_; ++i) given.back().tracks[i].calls = (*keeping)[i];
  kept.push_back(std::move(keeping));
}

Result<Recording> open_bytes(std::vector<std::byte> bytes, const ReadRecordingOptions& options) {
  auto all = std::make_shared<std::vector<std::byte>>(std::move(bytes));
  auto at = std::make_shared<std::size_t>(0);
  return Recording::open(
      [all, at](std::span<std::byte> out) -> Result<std::size_t> {
        const std::size_t n = std::min(out.size(), all->size() - *at);
        std::copy_n(all->begin() + static_cast<std::ptrdiff_t>(*at), n, out.begin());
        *at += n;
        return n;
      },
      "memory.palrec", options);
}

Status record(MemoryDisk& disk, RandomTicks& source, int ticks, const RecorderOptions& options) {
  Result<std::unique_ptr<Recorder>> made =
      Recorder::create(std::make_unique<MemoryFile>(disk), some_header(), source, options);
  if (!made) return made.error();
  Recorder& recorder = **made;
  for (const char* const name : {"cloud", "mesh-godobject"})
    if (const auto added = recorder.add_renderer({name, name, {{"shading", "auto"}}}); !added)
      return added.error();
  for (int i = 0; i < ticks; ++i) {
    recorder.wait_for_room();
    recorder.took(source.next());
  }
  return recorder.finish();
}

namespace {

bool alike(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
bool alike(const Vec3& a, const Vec3& b) {
  return alike(a.x(), b.x()) && alike(a.y(), b.y()) && alike(a.z(), b.z());
}

std::string difference_of_tracks(const RecordedTrack& a, const RecordedTrack& b) {
  if (a.renderer != b.renderer) return "renderer";
  if (a.stepped != b.stepped || a.calls_lost != b.calls_lost) return "stepped";
  if (!alike(a.frame.force_n, b.frame.force_n)) return "force";
  // Of a track that was not stepped nothing is known.
  if (a.stepped && !alike(a.frame.god_object_mm, b.frame.god_object_mm)) return "god object";
  if (a.frame.contact != b.frame.contact || a.frame.model != b.frame.model ||
      a.frame.status != b.frame.status)
    return "frame";
  if (a.step_ns != b.step_ns) return "step_ns";
  if (a.calls.size() != b.calls.size()) return "number of calls";
  for (std::size_t i = 0; i < a.calls.size(); ++i)
    if (a.calls[i].kind != b.calls[i].kind || !alike(a.calls[i].hip_mm, b.calls[i].hip_mm) ||
        !alike(a.calls[i].t_s, b.calls[i].t_s))
      return "call " + std::to_string(i);
  return {};
}

}  // namespace

std::string difference(const RecordedTick& a, const RecordedTick& b) {
  if (a.t_ns != b.t_ns || !alike(a.t_s, b.t_s) || a.dt_ns != b.dt_ns) return "time";
  if (a.late_ns != b.late_ns || a.exchange_ns != b.exchange_ns) return "timing";
  if (a.rearmed != b.rearmed || a.fault != b.fault) return "rearmed or fault";
  if (a.state.status != b.state.status || a.state.homed != b.state.homed ||
      a.state.buttons != b.state.buttons || a.state.packet_ns != b.state.packet_ns ||
      !alike(a.state.position_mm, b.state.position_mm))
    return "state";
  if (a.state.raw.size != b.state.raw.size || a.state.raw.bytes != b.state.raw.bytes) return "raw";
  if (!alike(a.hip_mm, b.hip_mm) || !alike(a.sent_n, b.sent_n)) return "HIP or sent";
  if (a.active != b.active || a.to != b.to || !alike(a.weight, b.weight) || a.request != b.request ||
      a.decision != b.decision)
    return "mix";
  if (a.track_count != b.track_count) return "tracks";
  for (std::size_t i = 0; i < a.track_count; ++i)
    if (std::string what = difference_of_tracks(a.tracks[i], b.tracks[i]); !what.empty())
      return "track " + std::to_string(i) + ": " + what;
  if (a.lost_before != b.lost_before) return "lost_before";
  return {};
}

}  // namespace palpate::device
