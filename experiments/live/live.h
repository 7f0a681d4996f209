// The whole of `palpate live`: several renderers under one hand, of which one is felt, switched while they
// are felt. On a simulated device, in real time or as fast as it goes, or on any that a driver makes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "device/live/mixer.h"
#include "experiments/live/assembly.h"
#include "experiments/live/remote.h"
#include "experiments/report/page.h"
#include "experiments/session/study_run.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {

class SessionLink;  // experiments/window/link.h

inline constexpr const char* kLiveFile = "live.json";
/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kLiveSchema = "palpate-live/1";

struct LiveArguments {
  RunArguments run;  ///< of it: scene, renderers, path, folder, model, surface, json
  DeviceArguments device;
  std::string hand;  ///< empty: explore; follow where another path is named; in a window the mouse
  std::string mapping = "1:1", rule = "wait", changes, record;
  std::string listen;    ///< PORT or ADDRESS:PORT; empty: nobody is heard
  double seconds = 0.0;  ///< 0: ten, in a window as long as it is open
  double switch_every_s = 0.0, rate_hz = 1000.0, fade_ms = 150.0;
  double stand_in = 60'000.0;  ///< points of what is felt while a large scene is prepared; 0: nothing is
  std::string up;              ///< what is up in a window; empty: what the scene says, else z
  bool window = false, headless = false, accelerated = false, rearm = false;
  bool replace = false;         ///< a recording that is there
  SessionLink* link = nullptr;  ///< of the window over it, which outlives it; null: none
};

/// What was left open, filled in.
[[nodiscard]] LiveArguments with_defaults(LiveArguments arguments);

/// A decision of the mixer that a person would ask about.
struct LiveDecision {
  double t_s = 0.0;
  device::SwitchSource source = device::SwitchSource::kProgram;
  device::MixDecision decision = device::MixDecision::kNone;
  device::SwitchReason reason = device::SwitchReason::kNone;
  std::uint8_t from = 0, to = 0;  ///< lanes; the same where there is no other
  double before_n = 0.0;          ///< force that went out
  double difference_n = 0.0;      ///< between the two
};

/// One renderer over the session.
struct LiveRenderer {
  std::string label, name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved at the end
  double prepare_ms = 0.0;
  std::uint64_t bytes = 0, shared_bytes = 0;
  std::uint64_t frames = 0, contact_frames = 0, felt_frames = 0;
  device::DurationStatistics step;
  double largest_step_n = 0.0;     ///< of its own force, from frame to frame, felt or not
  metrics::ForceSteps felt_steps;  ///< of its own force while it is felt
  std::uint32_t made = 1;          ///< 1, and one more for each change of parameters that it took
  std::string disqualified;
};

/// A stretch of the session, for the picture: means over it.
struct LiveSample {
  double t_s = 0.0;
  double out_n = 0.0;
  std::vector<double> each_n;
};

/// Of the session's recording; no file: it was not asked for.
struct LiveRecorded {
  std::string file;
  std::uint64_t ticks = 0, written = 0, lost = 0, bytes = 0;
};

/// What came over the network; no address: nobody was heard.
struct LiveRemote {
  std::string where;
  RemoteCounts counts;
};

struct LiveDocument {
  metrics::DocumentHead head;
  std::string scene, device, hand, grip, path, rule, scheduling;
  bool accelerated = false;
  double rate_hz = 1000.0, seconds = 0.0, fade_ms = 0.0;
  double world_per_device = 1.0, stiffness_n_per_mm = 0.0, felt_stiffness_n_per_mm = 0.0;
  double force_limit_n = 0.0;  ///< of the governor
  device::LoopStatistics loop;
  std::vector<device::DurationBin> lateness;
  std::uint64_t ticks = 0, faults = 0, rearmed = 0, half_rate_ticks = 0;
  std::uint64_t switches = 0, fades = 0, refused = 0, waited = 0;
  double largest_step_n = 0.0;    ///< of the force that goes out
  double largest_excess_n = 0.0;  ///< of a step at a switch above what it may be
  double steal_percent = 0.0;
  std::uint64_t resident_before_bytes = 0, resident_after_bytes = 0;
  std::uint64_t decisions_lost = 0;
  LiveRecorded recording;
  std::uint64_t watchdog_trips = 0;   ///< real time alone
  std::uint64_t replugged = 0;        ///< how often the device was gone and came back
  bool guarded = false;               ///< by a process of its own
  std::vector<std::string> unproven;  ///< of the device, without hardware
  LiveRemote remote;
  std::vector<SessionMark> marks;
  std::vector<std::string> fault_names;
  std::vector<LiveDecision> decisions;
  std::vector<LiveRenderer> renderers;
  std::vector<LiveSample> samples;
  std::vector<std::string> warnings, notes;
};

[[nodiscard]] std::string to_json(const LiveDocument& document);
[[nodiscard]] std::vector<Table> live_tables(const LiveDocument& document);
/// live.json, report.html with its figures.
[[nodiscard]] Status write_live(const LiveDocument& document, const OutputFolder& folder);

/// The exit status: 1 where the session ended with a fault latched.
int run_live(const LiveArguments& arguments, Context& context);
/// The same with these drivers.
int run_live_with(const LiveArguments& arguments, const device::Drivers& drivers, Context& context);

}  // namespace palpate::experiments
