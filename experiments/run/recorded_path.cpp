#include "experiments/run/recorded_path.h"

#include <utility>

#include <palpate/result.h>
#include "device/record/recording.h"
#include "toolkit/core/input_file.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kBytesASample = sizeof(double) + sizeof(Vec3);
// What a place that is let go at is before the first step, where nothing is before it: a frame at 1 kHz.
constexpr double kBeforeS = 1e-3;

class WayOfCalls {
 public:
  explicit WayOfCalls(trace::ProbePath& path) : path_(path) {}

  void add(const device::RendererCall& call) {
    if (!is_finite(call.hip_mm)) return;
    if (call.kind == device::RendererCall::Kind::kReleaseContact) {
      free_mm_ = call.hip_mm;
      let_go_ = true;
      return;
    }
    if (std::exchange(let_go_, false)) {
      const double before_s = path_.size() > 0 ? path_.t_s.back() : call.t_s - 2.0 * kBeforeS;
      push(free_mm_, 0.5 * (before_s + call.t_s));
    }
    push(call.hip_mm, call.t_s);
  }

 private:
  void push(const Vec3& hip_mm, double t_s) {
    if (path_.size() > 0 && !(t_s > path_.t_s.back())) return;
    path_.t_s.push_back(t_s);
    path_.hip_mm.push_back(hip_mm);
  }
  trace::ProbePath& path_;
  Vec3 free_mm_ = Vec3::Zero();  // where it let go, and did not step since
  bool let_go_ = false;
};

}  // namespace

Result<RecordedPath> path_of_recording(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(file));
  RecordedPath recorded;
  recorded.path.name = file;
  WayOfCalls way(recorded.path);
  device::RecordedTick tick;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    for (const device::RecordedTrack& track : tick.tracked()) {
      if (track.calls.empty()) continue;
      for (const device::RendererCall& call : track.calls) way.add(call);
      break;
    }
    if (recorded.path.size() * kBytesASample > max_bytes)
      return over_memory_limit("the path of " + file, max_bytes);
  }
  recorded.warnings = recording.end().warnings();
  if (recorded.path.size() == 0)
    return Error{"holds no step of any renderer", "record a session in which the device was held", file, 0};
  return recorded;
}

}  // namespace palpate::experiments
