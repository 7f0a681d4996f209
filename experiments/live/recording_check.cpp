#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/data/scene_scans.h"
#include "experiments/live/recording_segments.h"
#include "experiments/live/recording_session.h"
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
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
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 prepared_renderer(request, registry, scene, arguments.load.threads, context.progress));
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
  if (all.empty()) return Error{"the recording names no renderer", "name one with --renderers", file, 0};
  std::string text = all.front().name;
  for (const auto& [key, value] : all.front().options) {
    if (value.find_first_of(",:") != std::string::npos)
      return Error{fmt::format("the recorded value of '{}' cannot be written on a command line", key),
                   "name the renderer with --renderers", file, 0};
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
