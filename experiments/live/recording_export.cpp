#include "experiments/live/recording_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/live/recording_segments.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/message_text.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kBytesARow =
    sizeof(double) + sizeof(Vec3) + sizeof(render::Frame) + sizeof(std::int64_t);

Status check_export(const ExportArguments& a) {
  const auto wrong = [&](std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), a.out, 0};
  };
  std::error_code code;
  if (a.format == "motion-bids") {
    const auto is_label = [](const std::string& text) {
      return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
      });
    };
    if (!is_label(a.subject) || !is_label(a.task))
      return wrong("subject and task are labels of Motion-BIDS", "give them letters and digits alone");
    if (fs::exists(a.out, code) && !(fs::is_directory(a.out, code) && fs::is_empty(a.out, code)))
      return wrong("the folder is not empty", "name a new folder: a dataset stands alone in its own");
    return Done{};
  }
  const std::string ending = fs::path(a.out).extension().string();
  const std::string wanted = a.format == "csv" ? ".csv" : ".h5";
  if (ending != wanted)
    return wrong(fmt::format("a file of the format {} ends in {}", a.format, wanted),
                 "give --out FILE" + wanted);
  const fs::path folder = fs::path(a.out).parent_path();
  if (!folder.empty() && !fs::is_directory(folder, code))
    return wrong("the folder for it is not there", "create the folder first");
  if (fs::equivalent(a.out, a.recording, code)) return wrong("is the recording itself", "give another name");
  if (fs::exists(a.out, code) && !a.force)
    return wrong("is there already", "give another name, or --force to replace it");
  if (a.format == "hdf5" && !has_hdf5())
    return wrong("this program was built without HDF5", "install libhdf5-dev and build again, or export csv");
  return Done{};
}

void say(const ExportArguments& a, const device::Recording& recording, std::uint64_t rows) {
  const device::RecordingEnd& end = recording.end();
  std::vector<std::string> labels;
  for (const device::RecordedRenderer& one : recording.renderers()) labels.push_back(one.label);
  if (a.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"recording", a.recording},
                                              {"out", a.out},
                                              {"format", a.format},
                                              {"rows", rows},
                                              {"ticks", end.ticks},
                                              {"lost", end.lost},
                                              {"closed", end.closed},
                                              {"torn_bytes", end.torn_bytes},
                                              {"renderers", labels},
                                              {"warnings", end.warnings()}}
                           .dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
    return;
  }
  fmt::print("{}: {} rows of {} ticks; renderers: {}\n", a.out, rows, end.ticks, joined(labels));
}

}  // namespace

Result<std::uint64_t> export_csv(device::Recording& recording, const std::string& label,
                                 const std::string& file) {
  trace::ProbePath path;
  trace::ForceTrace trace;
  device::RecordedTick tick;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    const int index = find_recorded(recording, label);
    for (const device::RecordedTrack& track : tick.tracked()) {
      if (static_cast<int>(track.renderer) != index || !track.stepped || !is_finite(tick.hip_mm)) continue;
      if (path.size() > 0 && !(tick.t_s > path.t_s.back())) continue;
      path.t_s.push_back(tick.t_s);
      path.hip_mm.push_back(tick.hip_mm);
      trace.frames.push_back(track.frame);
      trace.frame_ns.push_back(track.step_ns);
      break;
    }
    if (path.size() * kBytesARow > kMemoryLimitBytes)
      return over_memory_limit("the frames of this recording", kMemoryLimitBytes);
  }
  if (recording.end().ticks == 0)
    return Error{"the recording ends before its first ticks are whole", "record again", file, 0};
  if (path.size() == 0) {
    std::vector<std::string> labels;
    for (const device::RecordedRenderer& one : recording.renderers()) labels.push_back(one.label);
    return Error{fmt::format("the recording has no frame of '{}'", label.empty() ? "any renderer" : label),
                 labels.empty() ? std::string("record a session in which the device was held")
                                : "choose from " + joined(labels),
                 file, 0};
  }
  PALPATE_TRY(trace::write_trace_csv(path, trace, file));
  return std::uint64_t{path.size()};
}

Result<int> run_export(const ExportArguments& arguments, Context& context) {
  PALPATE_TRY(check_export(arguments));
  device::ReadRecordingOptions options;
  options.skip_damaged = arguments.skip_damaged;
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(arguments.recording, options));
  context.progress.report("exporting", -1.0);
  PALPATE_ASSIGN(const std::uint64_t rows,
                 arguments.format == "csv" ? export_csv(recording, arguments.renderer, arguments.out)
                 : arguments.format == "hdf5"
                     ? export_hdf5(recording, arguments.out, context.progress)
                     : export_motion_bids(recording, arguments.out, arguments.subject, arguments.task));
  context.progress.clear();
  for (const std::string& warning : recording.end().warnings()) tell("palpate: warning: {}\n", warning);
  say(arguments, recording, rows);
  return kExitOk;
}

}  // namespace palpate::experiments
