#include "experiments/live/recording_session.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/session/version.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kBytesARow =
    sizeof(double) + sizeof(Vec3) + sizeof(render::Frame) + sizeof(std::int64_t);

Status check_export(const ExportArguments& a) {
  const auto wrong = [&](std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), a.out};
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

void announce(const ExportArguments& a, const device::Recording& recording, std::uint64_t rows) {
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

/// Writes one renderer's frames as a Palpate trace for read_trace_csv(). Returns the rows written.
Result<std::uint64_t> export_csv(device::Recording& recording, const std::string& label,
                                 const std::string& file) {
  const Result<trace::PathAndTrace> read = frames_of_recording(recording, label);
  if (!read) return Error(read.error()).in_file(file);
  PALPATE_TRY(trace::write_trace_csv(read->path, read->trace, file));
  return std::uint64_t{read->path.size()};
}

}  // namespace

Result<trace::PathAndTrace> frames_of_recording(device::Recording& recording, const std::string& label) {
  trace::PathAndTrace read;
  auto& [path, trace] = read;
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
    return Error{"the recording ends before its first ticks are whole", "record again"};
  if (path.size() == 0) {
    std::vector<std::string> labels;
    for (const device::RecordedRenderer& one : recording.renderers()) labels.push_back(one.label);
    return Error{fmt::format("the recording has no frame of '{}'", label.empty() ? "any renderer" : label),
                 labels.empty() ? std::string("record a session in which the device was held")
                                : "choose from " + joined(labels)};
  }
  return read;
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
  announce(arguments, recording, rows);
  return kExitOk;
}

namespace {

// Motion-BIDS: https://bids-specification.readthedocs.io, "Motion" (Jeung and others 2024).

namespace fs = std::filesystem;

constexpr const char* kBidsVersion = "1.9.0";
constexpr const char* kMissing = "n/a";
constexpr double kSPerNs = 1e-9;

struct BidsChannel {
  std::string name;
  const char* component;
  const char* type;
  std::string point;
  const char* units;
  const char* frame;
  std::string description;
};

void add_vector(std::vector<BidsChannel>& all, const std::string& name, const char* type,
                const std::string& point, const char* units, const char* frame,
                const std::string& description) {
  for (const char* const axis : {"x", "y", "z"})
    all.push_back({name + "_" + axis, axis, type, point, units, frame, description});
}

/// Channels in the order of the columns.
std::vector<BidsChannel> bids_channels() {
  std::vector<BidsChannel> all;
  all.push_back({"latency", "n/a", "LATENCY", "n/a", "s", "n/a", "time since the first sample"});
  add_vector(all, "hip", "POS", "hip", "mm", "world", "haptic interaction point");
  add_vector(all, "device", "POS", "device", "mm", "device", "position as the device measured it");
  add_vector(all, "god_object", "POS", "god_object", "mm", "world", "god object of the felt renderer");
  add_vector(all, "sent_force", "MISC", "device", "N", "device", "force that was sent to the device");
  all.push_back({"contact", "n/a", "MISC", "hip", "n/a", "n/a", "1 in contact, 0 in free space"});
  all.push_back({"buttons", "n/a", "MISC", "device", "n/a", "n/a", "one bit each"});
  all.push_back({"fault", "n/a", "MISC", "device", "n/a", "n/a", "0: none; else the number of the fault"});
  return all;
}

std::string channels_text(const std::vector<BidsChannel>& channels, double rate_hz) {
  std::string text =
      "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\tsampling_frequency\tdescription\n";
  for (const BidsChannel& c : channels)
    text += fmt::format("{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\n", c.name, c.component, c.type, c.point, c.units,
                        c.frame, rate_hz, c.description);
  return text;
}

void add_reals(std::string& row, const Vec3& v, bool known) {
  for (int axis = 0; axis < 3; ++axis)
    row += known ? fmt::format("\t{}", v[axis]) : fmt::format("\t{}", kMissing);
}

std::string row_of(const device::RecordedTick& tick, std::int64_t first_ns) {
  std::string row = fmt::format("{}", static_cast<double>(tick.t_ns - first_ns) * kSPerNs);
  add_reals(row, tick.hip_mm, is_finite(tick.hip_mm));
  add_reals(row, tick.state.position_mm, is_finite(tick.state.position_mm));
  const device::RecordedTrack* felt = tick.active >= 0 && tick.active < static_cast<int>(tick.track_count)
                                          ? &tick.tracks[static_cast<std::size_t>(tick.active)]
                                          : nullptr;
  const bool stepped = felt != nullptr && felt->stepped && is_finite(felt->frame.god_object_mm);
  add_reals(row, stepped ? felt->frame.god_object_mm : Vec3::Zero(), stepped);
  add_reals(row, tick.sent_n, is_finite(tick.sent_n));
  row += stepped ? fmt::format("\t{}", felt->frame.contact ? 1 : 0) : fmt::format("\t{}", kMissing);
  row += fmt::format("\t{}\t{}\n", tick.state.buttons, static_cast<int>(tick.fault));
  return row;
}

struct BidsCounts {
  std::uint64_t rows = 0;
  double seconds = 0.0;
};

std::string motion_json(const device::RecordingHeader& header, const std::vector<BidsChannel>& channels,
                        const std::string& task, const BidsCounts& counts) {
  std::uint64_t positions = 0, misc = 0;
  for (const BidsChannel& c : channels) {
    if (std::string_view(c.type) == "POS") ++positions;
    if (std::string_view(c.type) == "MISC") ++misc;
  }
  const double effective_hz =
      counts.seconds > 0.0 ? static_cast<double>(counts.rows - 1) / counts.seconds : header.rate_hz;
  return nlohmann::ordered_json{{"TaskName", task},
                                {"TaskDescription", "A surface is touched through a haptic device."},
                                {"SamplingFrequency", header.rate_hz},
                                {"SamplingFrequencyEffective", effective_hz},
                                {"RecordingDuration", counts.seconds},
                                {"RecordingType", "continuous"},
                                {"MissingValues", kMissing},
                                {"TrackingSystemName", "haptic"},
                                {"ManufacturersModelName", header.device},
                                {"SoftwareVersions", header.program},
                                {"TrackedPointsCount", 3},
                                {"MotionChannelCount", channels.size()},
                                {"POSChannelCount", positions},
                                {"MISCChannelCount", misc},
                                {"LATENCYChannelCount", 1}}
             .dump(2, ' ', false, nlohmann::json::error_handler_t::replace) +
         "\n";
}

std::string channels_json(const device::RecordingHeader& header) {
  const Vec3& t = header.world_from_device.translation_mm;
  const Eigen::Quaterniond& q = header.world_from_device.rotation;
  return nlohmann::ordered_json{
             {"reference_frame",
              {{"Description", "The frame that positions and forces are given in, right-handed."},
               {"Levels",
                {{"world",
                  {{"SpatialAxes", "n/a"},
                   {"RotationOrder", "n/a"},
                   {"RotationRule", "right-hand"},
                   {"Description", "the frame of the scene, mm"}}},
                 {"device",
                  {{"SpatialAxes", "n/a"},
                   {"RotationOrder", "n/a"},
                   {"RotationRule", "right-hand"},
                   {"Description",
                    fmt::format(
                        "the frame of the device, mm; world = R (scale device) + t with scale {}, t ({}, {}, "
                        "{}) and R of the unit quaternion w {}, x {}, y {}, z {}; mapping: {}",
                        header.scale, t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z(), header.mapping)}}}}}}}}
             .dump(2, ' ', false, nlohmann::json::error_handler_t::replace) +
         "\n";
}

std::string dataset_json() {
  return nlohmann::ordered_json{
             {"Name", "A recording of a haptic session"},
             {"BIDSVersion", kBidsVersion},
             {"DatasetType", "raw"},
             {"GeneratedBy", {{{"Name", "palpate report export"}, {"Version", version_text()}}}}}
             .dump(2) +
         "\n";
}

Status make_folder(const fs::path& folder) {
  std::error_code code;
  fs::create_directories(folder, code);
  if (code)
    return Error{"cannot create the folder: " + code.message(), "check the path and its permissions",
                 folder.string()};
  return Done{};
}

/// Writes everything into a folder that takes the dataset's name once complete.
Result<std::uint64_t> write_dataset(device::Recording& recording, const fs::path& folder,
                                    const std::string& subject, const std::string& task) {
  const fs::path motion = folder / ("sub-" + subject) / "motion";
  PALPATE_TRY(make_folder(motion));
  const std::string stem = fmt::format("sub-{}_task-{}_tracksys-haptic", subject, task);
  const std::vector<BidsChannel> channels = bids_channels();
  PALPATE_ASSIGN(AtomicFile rows, AtomicFile::create((motion / (stem + "_motion.tsv")).string()));
  device::RecordedTick tick;
  BidsCounts counts;
  std::int64_t first_ns = 0, last_ns = 0;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    if (counts.rows == 0) first_ns = tick.t_ns;
    last_ns = tick.t_ns;
    PALPATE_TRY(rows.write(row_of(tick, first_ns)));
    ++counts.rows;
  }
  counts.seconds = static_cast<double>(last_ns - first_ns) * kSPerNs;
  if (counts.rows == 0) return Error{"the recording has no ticks", "record a session", folder.string()};
  PALPATE_TRY(rows.commit());
  const device::RecordingHeader& header = recording.header();
  const auto file = [&](const char* ending) { return (motion / (stem + ending)).string(); };
  PALPATE_TRY(write_file(file("_motion.json"), motion_json(header, channels, task, counts)));
  // File names equal the motion file's, with another suffix.
  PALPATE_TRY(write_file(file("_channels.tsv"), channels_text(channels, header.rate_hz)));
  PALPATE_TRY(write_file(file("_channels.json"), channels_json(header)));
  PALPATE_TRY(write_file((folder / "dataset_description.json").string(), dataset_json()));
  PALPATE_TRY(write_file((folder / "participants.tsv").string(), "participant_id\nsub-" + subject + "\n"));
  PALPATE_TRY(
      write_file((folder / "README").string(),
                 "A recording of a haptic session, exported by palpate. The motion file has no header; "
                 "its columns\nare those of the channels file, in that order.\n"));
  return counts.rows;
}

}  // namespace

Result<std::uint64_t> export_motion_bids(device::Recording& recording, const std::string& folder,
                                         const std::string& subject, const std::string& task) {
  fs::path whole = fs::path(folder).lexically_normal();
  if (!whole.has_filename()) whole = whole.parent_path();
  const fs::path part = whole.string() + ".part";
  std::error_code code;
  fs::remove_all(part, code);
  const auto removed_at_stop = StopCallback([part] {
    std::error_code ignored;
    fs::remove_all(part, ignored);
    return std::string();
  });
  Result<std::uint64_t> rows = write_dataset(recording, part, subject, task);
  if (rows) {
    fs::remove(whole, code);  // removes an empty folder
    fs::rename(part, whole, code);
    if (code) rows = Error{"cannot name the folder: " + code.message(), "name another one", folder};
  }
  if (!rows) fs::remove_all(part, code);
  return rows;
}

}  // namespace palpate::experiments
