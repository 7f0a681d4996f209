#include "experiments/live/recording_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using FactsJson = nlohmann::ordered_json;

constexpr double kSecondsPerNs = 1e-9, kMsPerNs = 1e-6, kUsPerNs = 1e-3;

class TickCounter {
 public:
  explicit TickCounter(RecordingFacts& facts) : facts_(facts), decided_(facts.header.decisions.size()) {}

  void count(const device::RecordedTick& tick) {
    if (!begun_) first_ns_ = tick.t_ns;
    if (!begun_ || tick.rearmed) ++facts_.segments;
    // The first tick after arming starts a new count: the same fault then is another one.
    const device::Fault before = begun_ && !tick.rearmed ? fault_ : device::Fault::kNone;
    if (tick.fault != device::Fault::kNone && tick.fault != before) count_fault(tick);
    fault_ = tick.fault;
    begun_ = true;
    facts_.late_max_ms = std::max(facts_.late_max_ms, static_cast<double>(tick.late_ns) * kMsPerNs);
    if (is_finite(tick.sent_n)) facts_.force_max_n = std::max(facts_.force_max_n, tick.sent_n.norm());
    if (tick.decision != 0) ++decided_[tick.decision];
    count_tracks(tick);
  }
  void finish() {
    for (std::size_t i = 1; i < decided_.size(); ++i)
      if (decided_[i] > 0) facts_.decisions.emplace_back(facts_.header.decisions[i], decided_[i]);
  }

 private:
  void count_fault(const device::RecordedTick& tick) {
    const std::string name = device::fault_name(tick.fault);
    auto known = std::find_if(facts_.faults.begin(), facts_.faults.end(),
                              [&](const RecordedFault& fault) { return fault.name == name; });
    if (known == facts_.faults.end())
      known =
          facts_.faults.insert(known, {name, 0, static_cast<double>(tick.t_ns - first_ns_) * kSecondsPerNs});
    ++known->times;
  }
  void count_tracks(const device::RecordedTick& tick) {
    int index = 0;
    for (const device::RecordedTrack& track : tick.tracked()) {
      const bool felt = index++ == tick.active;
      if (track.renderer >= facts_.renderers.size()) facts_.renderers.resize(track.renderer + 1u);
      RecordedRendererFacts& renderer = facts_.renderers[track.renderer];
      renderer.felt_ticks += felt;
      if (!track.stepped) continue;
      ++renderer.ticks;
      renderer.contact_ticks += track.frame.contact;
      renderer.step_max_us = std::max(renderer.step_max_us, static_cast<double>(track.step_ns) * kUsPerNs);
    }
  }

  RecordingFacts& facts_;
  std::vector<std::uint64_t> decided_;
  bool begun_ = false;
  std::int64_t first_ns_ = 0;
  device::Fault fault_ = device::Fault::kNone;
};

FactsJson device_json(const device::RecordingHeader& header) {
  const device::DeviceLimits& limits = header.limits;
  const auto known = [](double value) { return value > 0.0 ? FactsJson(value) : FactsJson(nullptr); };
  return {{"name", header.device},
          {"force_max_n", known(limits.force_max_n)},
          {"resolution_mm", known(limits.resolution_mm)},
          {"rate_hz", known(limits.rate_hz)}};
}

FactsJson renderers_json(const RecordingFacts& facts) {
  FactsJson list = FactsJson::array();
  for (const RecordedRendererFacts& one : facts.renderers) {
    FactsJson options = FactsJson::object();
    for (const auto& [key, value] : one.renderer.options) options[key] = value;
    list.push_back({{"label", one.renderer.label},
                    {"name", one.renderer.name},
                    {"options", options},
                    {"ticks", one.ticks},
                    {"contact_ticks", one.contact_ticks},
                    {"felt_ticks", one.felt_ticks},
                    {"step_max_us", one.step_max_us}});
  }
  return list;
}

/// A text from the file as one terminal line; removes control characters, which would move the cursor.
std::string line_of_text(std::string text) {
  constexpr unsigned char kFirstPrintable = 0x20, kDelete = 0x7F;
  std::erase_if(text, [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte < kFirstPrintable || byte == kDelete;
  });
  return text.empty() ? std::string("not said") : text;
}

std::string times_text(std::uint64_t times) {
  return times == 1 ? std::string("once") : fmt::format("{} times", format_count(times));
}

std::string faults_text(const std::vector<RecordedFault>& faults) {
  std::vector<std::string> words;
  for (const RecordedFault& fault : faults)
    words.push_back(
        fmt::format("{} {}, first after {:.3f} s", fault.name, times_text(fault.times), fault.first_s));
  return words.empty() ? std::string("none") : joined(words, "; ");
}

std::string device_text(const device::RecordingHeader& header) {
  std::string text = line_of_text(header.device);
  if (header.limits.force_max_n > 0.0) text += fmt::format(", {:.3g} N", header.limits.force_max_n);
  if (header.limits.resolution_mm > 0.0) text += fmt::format(", {:.3g} mm", header.limits.resolution_mm);
  if (header.limits.rate_hz > 0.0) text += fmt::format(", {:.4g} Hz", header.limits.rate_hz);
  return text;
}

}  // namespace

Result<RecordingFacts> facts_of_recording(const std::string& file, bool skip_damaged) {
  device::ReadRecordingOptions options;
  options.skip_damaged = skip_damaged;
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(file, options));
  RecordingFacts facts;
  facts.file = file;
  facts.header = recording.header();
  TickCounter counter(facts);
  device::RecordedTick tick;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    counter.count(tick);
  }
  counter.finish();
  facts.end = recording.end();
  facts.length_s = static_cast<double>(facts.end.last_ns - facts.end.first_ns) * kSecondsPerNs;
  facts.renderers.resize(recording.renderers().size());
  for (std::size_t i = 0; i < facts.renderers.size(); ++i)
    facts.renderers[i].renderer = recording.renderers()[i];
  facts.notes = recording.notes();
  constexpr std::uint64_t kCameraAlone = 1;
  if (facts.end.depth_images > kCameraAlone) {
    // Ticks are worth telling of where images are damaged.
    Result<StreamFacts> stream = facts_of_stream(file, {}, no_progress());
    if (stream)
      facts.stream = *std::move(stream);
    else
      facts.notes.push_back("its depth images: " + stream.error().message());
  }
  std::error_code code;
  const std::uintmax_t bytes = std::filesystem::file_size(file, code);
  facts.bytes = code ? 0 : bytes;
  return facts;
}

namespace {

std::uint32_t version_of(const RecordingFacts& facts) {
  return facts.end.depth_images > 0 ? device::kRecordingVersionWithDepth : device::kRecordingVersion;
}

}  // namespace

std::string facts_json(const RecordingFacts& facts) {
  const device::RecordingHeader& header = facts.header;
  FactsJson json = {{"recording", facts.file},
                    {"format", fmt::format("palrec {}", version_of(facts))},
                    {"bytes", facts.bytes},
                    {"program", header.program},
                    {"machine", header.machine},
                    {"started_utc", header.started_utc},
                    {"scene", header.scene},
                    {"scene_hash", header.scene_hash},
                    {"has_scene_file", !header.scene_text.empty()},
                    {"device", device_json(header)},
                    {"mapping", header.mapping},
                    {"scale", header.scale},
                    {"rate_hz", header.rate_hz},
                    {"scheduling", header.scheduling},
                    {"length_s", facts.length_s},
                    {"ticks", facts.end.ticks},
                    {"lost_ticks", facts.end.lost},
                    {"segments", facts.segments},
                    {"late_max_ms", facts.late_max_ms},
                    {"force_max_n", facts.force_max_n}};
  json["faults"] = FactsJson::array();
  for (const RecordedFault& fault : facts.faults)
    json["faults"].push_back({{"name", fault.name}, {"times", fault.times}, {"first_s", fault.first_s}});
  json["decisions"] = FactsJson::array();
  for (const auto& [decision, ticks] : facts.decisions)
    json["decisions"].push_back({{"decision", decision}, {"ticks", ticks}});
  json["renderers"] = renderers_json(facts);
  json["notes"] = facts.notes;
  if (facts.stream) json["stream"] = FactsJson::parse(to_json(*facts.stream));
  json["closed"] = facts.end.closed;
  json["reason"] = facts.end.closed ? FactsJson(facts.end.reason) : FactsJson(nullptr);
  json["warnings"] = facts.end.warnings();
  return json.dump(2, ' ', false, FactsJson::error_handler_t::replace);
}

std::string facts_text(const RecordingFacts& facts) {
  const device::RecordingHeader& header = facts.header;
  std::string text = facts.file + "\n";
  const auto row = [&](const std::string& key, const std::string& value) {
    text += fmt::format("  {:<18} {}\n", key, value);
  };
  row("format",
      fmt::format("palrec {}, {}", version_of(facts), format_bytes(static_cast<double>(facts.bytes))));
  row("recorded", fmt::format("{}, by {}", line_of_text(header.started_utc), line_of_text(header.program)));
  row("machine", line_of_text(header.machine));
  row("scene",
      fmt::format("{}{}", line_of_text(header.scene), header.scene_text.empty() ? "" : ", its file is kept"));
  row("scene hash", line_of_text(header.scene_hash));
  row("device", device_text(header));
  row("mapping", line_of_text(header.mapping));
  row("loop", fmt::format("{:.4g} Hz, {}", header.rate_hz, line_of_text(header.scheduling)));
  row("length", fmt::format("{:.3f} s, {} ticks, {} lost", facts.length_s, format_count(facts.end.ticks),
                            facts.end.lost == 0 ? std::string("none") : format_count(facts.end.lost)));
  row("latest tick", fmt::format("{} after it was due", format_duration(facts.late_max_ms)));
  row("segments", fmt::format("{}, from one arming to the next", format_count(facts.segments)));
  row("faults", faults_text(facts.faults));
  row("largest force", fmt::format("{:.3g} N sent", facts.force_max_n));
  for (const auto& [decision, ticks] : facts.decisions)
    row("mixer", fmt::format("{}, {}", line_of_text(decision), times_text(ticks)));
  for (const RecordedRendererFacts& one : facts.renderers) {
    row("renderer", fmt::format("{} ({}): stepped in {} ticks, {} in contact; felt in {}; longest {}",
                                line_of_text(one.renderer.label), line_of_text(one.renderer.name),
                                format_count(one.ticks), format_count(one.contact_ticks),
                                format_count(one.felt_ticks), format_duration(1e-3 * one.step_max_us)));
    std::vector<std::string> options;
    for (const auto& [key, value] : one.renderer.options) options.push_back(line_of_text(key + "=" + value));
    if (!options.empty()) row("  with", joined(options));
  }
  if (facts.renderers.empty()) row("renderer", "none");
  for (const std::string& note : facts.notes) row("note", line_of_text(note));
  if (facts.end.closed) row("ended", line_of_text(facts.end.reason));
  for (const std::string& warning : facts.end.warnings()) text += fmt::format("  warning: {}\n", warning);
  if (facts.stream) text += to_text(*facts.stream);
  return text;
}

}  // namespace palpate::experiments
