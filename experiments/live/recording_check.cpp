#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/live/recording_session.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::experiments {
namespace {

constexpr double kSegmentSPerNs = 1e-9;
// Interval of progress reports.
constexpr std::uint64_t kTicksAReport = 10'000;
// Time step of a renderer prepared before the recording began.
constexpr double kNominalDtS = 1e-3;

std::string one_hash(const render::Frame& frame) {
  trace::FrameHash hash;
  hash.add(frame);
  return hash.hex();
}

/// Repeats a tick's recorded calls on the renderer and returns the last step's answer.
class Asking {
 public:
  explicit Asking(render::HapticRenderer& renderer) : renderer_(renderer) {}
  render::Frame ask(std::span<const device::RendererCall> calls) {
    render::Frame frame;
    for (const device::RendererCall& call : calls) {
      using Kind = device::RendererCall::Kind;
      if (!begun_ && call.kind != Kind::kRestart)
        renderer_.restart(call.hip_mm, (call.kind == Kind::kStep ? call.t_s : 0.0) - kNominalDtS);
      begun_ = true;
      if (call.kind == Kind::kRestart) renderer_.restart(call.hip_mm, call.t_s);
      if (call.kind == Kind::kReleaseContact) renderer_.release_contact(call.hip_mm);
      if (call.kind == Kind::kStep) frame = renderer_.step(call.hip_mm, call.t_s);
    }
    return frame;
  }

 private:
  render::HapticRenderer& renderer_;
  bool begun_ = false;
};

class OpenSegment {
 public:
  void begin(const device::RecordedTick& tick) {
    close();
    current_ = {};
    open_ = true;
    current_.start_ns = tick.t_ns;
    recorded_ = replayed_ = trace::FrameHash();
    arrived_ = false;
  }
  [[nodiscard]] bool is_open() const { return open_; }
  void add(const device::RecordedTick& tick, const device::RecordedTrack& track,
           const render::Frame& answer) {
    SegmentReplay& s = current_;
    s.end_ns = tick.t_ns;
    s.faulted = tick.fault != device::Fault::kNone;
    s.whole = s.whole && !track.calls_lost;
    if (s.frames == 0)
      for (const device::RendererCall& call : track.calls)
        s.brought_up = s.brought_up || call.kind != device::RendererCall::Kind::kStep;
    if (!track.stepped) return;
    // During a bring-up the renderer is not at the hand yet.
    if (!arrived_ && (track.calls.empty() || track.calls.back().hip_mm == tick.hip_mm)) {
      arrived_ = true;
      s.starts_in_contact = track.frame.contact;
    }
    ++s.frames;
    if (track.frame.contact) ++s.contact_frames;
    recorded_.add(track.frame);
    replayed_.add(answer);
    if (s.differs_ns < 0 && one_hash(track.frame) != one_hash(answer)) s.differs_ns = tick.t_ns;
  }
  void miss() {
    if (open_) current_.whole = false;
  }
  void close() {
    if (!open_) return;
    current_.recorded_hash = recorded_.hex();
    current_.replayed_hash = replayed_.hex();
    if (current_.frames > 0) done.push_back(std::move(current_));
    open_ = false;
  }
  std::vector<SegmentReplay> done;

 private:
  SegmentReplay current_;
  bool open_ = false;
  bool arrived_ = false;  // the renderer has reached the hand
  trace::FrameHash recorded_, replayed_;
};

}  // namespace

int find_recorded(const device::Recording& recording, const std::string& label) {
  const std::vector<device::RecordedRenderer>& all = recording.renderers();
  for (std::size_t i = 0; i < all.size(); ++i)
    if (label.empty() || all[i].label == label) return static_cast<int>(i);
  return -1;
}

Result<std::vector<SegmentReplay>> replay_segments(device::Recording& recording, const std::string& label,
                                                   render::HapticRenderer& renderer, Progress& progress) {
  OpenSegment segment;
  Asking asking(renderer);
  device::RecordedTick tick;
  std::size_t damaged = 0;
  bool any = false;
  for (std::uint64_t ticks = 0;; ++ticks) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    if (ticks % kTicksAReport == 0) progress.report("replaying the recording", -1.0);
    // The last of several renderers with one label counts: it replaced the others.
    const int index = find_recorded(recording, label);
    const bool gap = tick.lost_before > 0 || recording.end().damaged.size() > damaged;
    damaged = recording.end().damaged.size();
    if (gap) segment.miss();
    if (tick.rearmed || !segment.is_open()) segment.begin(tick);
    // Lost ticks may have held the segment's beginning.
    if (gap && !tick.rearmed) segment.miss();
    for (const device::RecordedTrack& track : tick.tracked()) {
      if (static_cast<int>(track.renderer) != index) continue;
      any = true;
      segment.add(tick, track, asking.ask(track.calls));
      break;
    }
  }
  segment.close();
  if (!any)
    return Error{label.empty() ? "the recording has no renderer"
                               : fmt::format("the recording has no renderer '{}'", label),
                 "name one of those that it has: `palpate report export` lists them"};
  return std::move(segment.done);
}

std::string segments_text(const std::vector<SegmentReplay>& segments) {
  std::string text;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const SegmentReplay& s = segments[i];
    text +=
        fmt::format("segment {}: from {:.3f} s, {} frames, {} in contact{}{}: ", i + 1,
                    static_cast<double>(s.start_ns) * kSegmentSPerNs, s.frames, s.contact_frames,
                    s.starts_in_contact ? ", starts in contact" : "", s.faulted ? ", ends in a fault" : "");
    if (s.same())
      text += fmt::format("the same hash, {}\n", s.recorded_hash);
    else
      text += fmt::format("recorded {}, replayed {}, differs from {:.6f} s on{}\n", s.recorded_hash,
                          s.replayed_hash, static_cast<double>(s.differs_ns) * kSegmentSPerNs,
                          s.whole ? "" : " (ticks of it were lost, so it may)");
  }
  return text;
}

std::string segments_json(const std::vector<SegmentReplay>& segments, const std::string& recording,
                          const std::string& renderer) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const SegmentReplay& s : segments)
    all.push_back({{"start_s", static_cast<double>(s.start_ns) * kSegmentSPerNs},
                   {"end_s", static_cast<double>(s.end_ns) * kSegmentSPerNs},
                   {"frames", s.frames},
                   {"contact_frames", s.contact_frames},
                   {"starts_in_contact", s.starts_in_contact},
                   {"brought_up", s.brought_up},
                   {"faulted", s.faulted},
                   {"whole", s.whole},
                   {"recorded_hash", s.recorded_hash},
                   {"replayed_hash", s.replayed_hash},
                   {"same", s.same()}});
  return nlohmann::ordered_json{{"schema", "palpate-segments/1"},
                                {"recording", recording},
                                {"renderer", renderer},
                                {"segments", all}}
             .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
         "\n";
}

namespace {

bool is_same(const device::RecordedRenderer& a, const device::RecordedRenderer& b) {
  const auto sorted = [](std::vector<std::pair<std::string, std::string>> options) {
    std::sort(options.begin(), options.end());
    return options;
  };
  return a.name == b.name && sorted(a.options) == sorted(b.options);
}

/// Replays the named renderer; empty if the recording has none such.
Result<std::string> replay_named(const RunArguments& arguments, const std::string& folder, Context& context,
                                 int& status) {
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(const CheckedRun checked, check_run(arguments, registry, context.progress));
  if (checked.renderers.empty()) return std::string();
  const RendererRequest& request = checked.renderers.front();
  PALPATE_ASSIGN(const device::RecordedRenderer wanted, recorded_renderer(request, registry));
  PALPATE_ASSIGN(const std::vector<device::RecordedRenderer> recorded,
                 renderers_of_recording(arguments.path));
  const auto found = std::find_if(recorded.begin(), recorded.end(),
                                  [&](const device::RecordedRenderer& one) { return is_same(one, wanted); });
  if (found == recorded.end())
    return fmt::format("{} was not recorded with these options: no hashes to compare\n", request.label);
  PALPATE_ASSIGN(const scene::LoadedScene scene,
                 scene::load(checked.stage.scene, all_readers(), checked.stage.load, context.progress));
  PALPATE_ASSIGN(
      const std::unique_ptr<render::HapticRenderer> renderer,
      prepared_renderer(request, registry, scene, arguments.load.threads, false, context.progress));
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(arguments.path));
  PALPATE_ASSIGN(const std::vector<SegmentReplay> segments,
                 replay_segments(recording, found->label, *renderer, context.progress));
  PALPATE_TRY(
      write_file(folder + "/" + kSegmentsFile, segments_json(segments, arguments.path, found->label)));
  const bool same_scene =
      recording.header().scene_hash == scene_hash(checked.stage.scene, scene, arguments.surface);
  const bool same = std::all_of(segments.begin(), segments.end(), [](const SegmentReplay& segment) {
    return segment.same() || !segment.whole;
  });
  if (same_scene && !same) status = kExitFellShort;
  std::string text = segments_text(segments);
  if (!same_scene) text += "the scene is another one than the recorded: other hashes are no fault\n";
  return text;
}

}  // namespace

Result<std::vector<device::RecordedRenderer>> renderers_of_recording(const std::string& file) {
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(file));
  device::RecordedTick tick;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
  }
  return recording.renderers();
}

Result<std::string> renderer_of_recording(const std::string& file) {
  PALPATE_ASSIGN(const std::vector<device::RecordedRenderer> all, renderers_of_recording(file));
  if (all.empty()) return Error{"the recording names no renderer", "name one with --renderers", file};
  std::string text = all.front().name;
  for (const auto& [key, value] : all.front().options) {
    if (value.find_first_of(",:") != std::string::npos)
      return Error{fmt::format("the recorded value of '{}' cannot be written on a command line", key),
                   "name the renderer with --renderers", file};
    text += ":" + key + "=" + value;
  }
  return text + ":label=" + all.front().label;
}

int check_recording(const RunArguments& arguments, const std::string& folder, Context& context) {
  int status = kExitOk;
  const Result<std::string> text = replay_named(arguments, folder, context, status);
  context.progress.clear();
  if (!text) return fail(text.error(), kExitFellShort);
  if (arguments.json)
    tell("{}", *text);
  else
    fmt::print("{}", *text);
  if (status != kExitOk)
    return fail({"the renderer answers otherwise than when it was recorded",
                 "compare the programs: the recording says which one made it", arguments.path, 0},
                status);
  return status;
}

}  // namespace palpate::experiments
