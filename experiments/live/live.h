// `palpate live`: several renderers under one hand, one felt, switched during contact. Runs on a simulated
// device, in real time or faster, or on any driver's device.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "device/live/mixer.h"
#include "experiments/driver/study_run.h"
#include "experiments/live/assembly.h"
#include "experiments/live/live_stream.h"
#include "experiments/live/remote.h"
#include "experiments/report/page.h"
#include "toolkit/metrics/force_steps.h"

namespace palpate::experiments {

class SessionLink;  // experiments/window/link.h

inline constexpr const char* kLiveFile = "live.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kLiveSchema = "palpate-live/1";

struct LiveArguments {
  RunArguments run;  ///< scene, renderers, path, folder, model, surface, json
  DeviceArguments device;
  std::string hand;  ///< empty: "mouse" in a window; "follow" if a path other than "hand" is named; else
                     ///< "explore"
  std::string mapping = "1:1", rule = "wait", changes, record;
  std::string listen;    ///< PORT or ADDRESS:PORT; empty: do not listen
  double seconds = 0.0;  ///< 0: ten, or until the window closes
  double switch_every_s = 0.0, rate_hz = 1000.0, fade_ms = 150.0;
  double stand_in = 60'000.0;  ///< points rendered while a large scene is prepared; 0: none
  std::string up;              ///< the window's up axis; empty: the scene's, else z
  bool window = false, accelerated = false, rearm = false;
  bool replace = false;         ///< overwrites an existing recording
  SessionLink* link = nullptr;  ///< link of the window, which outlives the session; null: no window
};

/// A decision of the mixer worth reporting.
struct LiveDecision {
  double t_s = 0.0;
  device::SwitchSource source = device::SwitchSource::kProgram;
  device::MixDecision decision = device::MixDecision::kNone;
  device::SwitchReason reason = device::SwitchReason::kNone;
  std::uint8_t from = 0, to = 0;  ///< lanes; equal if no other is involved
  double before_n = 0.0;          ///< force sent
  double difference_n = 0.0;      ///< between the two
};

/// Facts of one renderer over the session.
struct LiveRenderer {
  std::string label, name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved at the end
  double prepare_ms = 0.0;
  std::uint64_t bytes = 0, shared_bytes = 0;
  std::uint64_t frames = 0, contact_frames = 0, felt_frames = 0;
  std::uint64_t late_frames = 0, coarse_frames = 0;  ///< of a prepared file: render::FrameCounters
  std::uint64_t swaps = 0, stalled_frames = 0;       ///< of a stream: the same
  device::DurationStatistics step;
  double largest_step_n = 0.0;     ///< of its own force between frames, felt or not
  metrics::ForceSteps felt_steps;  ///< of its own force while felt
  std::uint32_t made = 1;          ///< 1 plus the parameter changes taken over
  std::string disqualified;
};

/// Means over a stretch of the session, for the chart.
struct LiveSample {
  double t_s = 0.0;
  double out_n = 0.0;
  std::vector<double> each_n;
};

/// Facts of the recording; no file: not recorded.
struct LiveRecorded {
  std::string file;
  std::uint64_t ticks = 0, written = 0, lost = 0, bytes = 0;
};

/// Facts of network commands; no address: did not listen.
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
  double force_limit_n = 0.0;  ///< the governor's
  device::LoopStatistics loop;
  std::vector<device::DurationBin> lateness;
  std::uint64_t ticks = 0, faults = 0, rearmed = 0, half_rate_ticks = 0;
  std::uint64_t switches = 0, fades = 0, refused = 0, waited = 0;
  double largest_step_n = 0.0;    ///< of the force sent
  double largest_excess_n = 0.0;  ///< largest excess of a switch's force step above its bound
  double steal_percent = 0.0;
  std::uint64_t resident_before_bytes = 0, resident_after_bytes = 0;
  std::uint64_t decisions_lost = 0;
  LiveRecorded recording;
  std::uint64_t watchdog_trips = 0;   ///< real time only
  std::uint64_t replugged = 0;        ///< times the device was lost and came back
  bool guarded = false;               ///< by a separate process
  std::vector<std::string> unproven;  ///< device properties unproven on hardware
  LiveRemote remote;
  LiveStreamFacts stream;
  std::vector<SessionMark> marks;
  std::vector<std::string> fault_names;
  std::vector<LiveDecision> decisions;
  std::vector<LiveRenderer> renderers;
  std::vector<LiveSample> samples;
  std::vector<std::string> warnings, notes;
  int stopped_by = 0;  ///< the signal that ended it; 0: none. Not in the file
};

[[nodiscard]] std::string to_json(const LiveDocument& document);
[[nodiscard]] std::vector<Table> live_tables(const LiveDocument& document);
/// Draws the figures into the folder.
[[nodiscard]] Page live_page(const LiveDocument& document, const OutputFolder& folder);

/// Returns the exit status: 1 if the session ended with a latched fault, 128 + signal if one ended it.
int run_live(const LiveArguments& arguments, Context& context);
/// The same with these drivers.
int run_live_with(const LiveArguments& arguments, const device::Drivers& drivers, Context& context);

}  // namespace palpate::experiments
