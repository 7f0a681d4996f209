// `palpate live record`: records one renderer under a hand, and checks recordings against their renderer.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "device/record/recording.h"
#include "device/record/recording_header.h"
#include "experiments/driver/study_run.h"
#include "experiments/live/session_device.h"
#include "experiments/session/session.h"
#include "experiments/streams/open_stream.h"

namespace palpate::experiments {

struct RecordArguments {
  std::string scene, renderer;
  DeviceArguments device;
  std::string path;  ///< the hand's goal; empty: sized to the model, lasting the session
  std::string out;   ///< FILE.palrec
  double seconds = 10.0;
  int rate_hz = 1000;
  std::string flush = "disk";  ///< per chunk: disk or system
  bool accelerated = false;    ///< virtual clock, as fast as possible
  bool force = false, json = false;
  SurfaceArguments surface;
  ModelArguments load;
};
int run_record(const RecordArguments& arguments, Context& context);
/// The same with these drivers.
int run_record_with(const RecordArguments& arguments, const device::Drivers& drivers, Context& context);

/// Checks that a recording can be written there; `replace` allows an existing file. Errors give the remedy.
[[nodiscard]] Status check_recording_file(const std::string& file, bool replace);

/// Program, machine and scene of a recording's header; the session adds device, mapping and time.
[[nodiscard]] device::RecordingHeader recording_header(const std::string& scene, const scene::SceneFile& file,
                                                       const scene::LoadedScene& loaded,
                                                       const SurfaceArguments& surface);

/// Hash of everything that determines the force: models, surfaces, control.
[[nodiscard]] std::string scene_hash(const scene::SceneFile& file, const scene::LoadedScene& scene,
                                     const SurfaceArguments& surface);

/// The prepared renderer inside the session's wrappers: control, moving models.
[[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> prepared_renderer(
    const RendererRequest& request, const render::Registry& registry, const scene::LoadedScene& scene,
    int threads, bool paced, Progress& progress);

/// The renderer as a recording stores it, with every option.
[[nodiscard]] Result<device::RecordedRenderer> recorded_renderer(const RendererRequest& request,
                                                                 const render::Registry& registry);

/// Renderers in a recording; reads all of it.
[[nodiscard]] Result<std::vector<device::RecordedRenderer>> renderers_of_recording(const std::string& file);

/// Replays the recording `arguments.path` segment by segment if it has a renderer with these options; prints
/// the hashes and writes them to the folder. Exit status 1: the same renderer on the same scene answers
/// differently.
int check_recording(const RunArguments& arguments, const std::string& folder, Context& context);

/// The recording's first renderer, as --renderer accepts it.
[[nodiscard]] Result<std::string> renderer_of_recording(const std::string& file);

// Replays a recording through a renderer, segment by segment between rearms. The same recorded calls must
// give identical bits.

/// The ticks between two armings.
struct SegmentReplay {
  std::int64_t start_ns = 0, end_ns = 0;  ///< servo clock
  std::uint64_t frames = 0;               ///< ticks with a step
  std::uint64_t contact_frames = 0;
  bool starts_in_contact = false;            ///< its first frame at the hand, after any bring-up
  bool brought_up = false;                   ///< the renderer released its contact or restarted at the
                                             ///< beginning
  bool faulted = false;                      ///< ends with a fault
  bool whole = true;                         ///< no call is missing in the recording
  std::string recorded_hash, replayed_hash;  ///< trace hashes
  std::int64_t differs_ns = -1;              ///< first differing frame's time; -1: none

  [[nodiscard]] bool same() const { return recorded_hash == replayed_hash; }
};

/// Table index of the renderer with this label in the part read so far; -1: none.
[[nodiscard]] int find_recorded(const device::Recording& recording, const std::string& label);

/// Replays the whole recording. `label` names the renderer compared with; empty: the first. `renderer` must
/// be prepared. Error: the recording lacks it. Memory does not grow with the recording.
[[nodiscard]] Result<std::vector<SegmentReplay>> replay_segments(device::Recording& recording,
                                                                 const std::string& label,
                                                                 render::HapticRenderer& renderer,
                                                                 Progress& progress);

/// A terminal table, one line per segment.
[[nodiscard]] std::string segments_text(const std::vector<SegmentReplay>& segments);
/// {"schema": "palpate-segments/1", "recording", "renderer", "segments": [..]}.
[[nodiscard]] std::string segments_json(const std::vector<SegmentReplay>& segments,
                                        const std::string& recording, const std::string& renderer);
inline constexpr const char* kSegmentsFile = "segments.json";

// `palpate report export`: writes recordings in other programs' formats.

struct ExportArguments {
  std::string recording;
  std::string format = "csv";                  ///< csv, hdf5, motion-bids
  std::string out;                             ///< a file; a folder for motion-bids
  std::string renderer;                        ///< csv: a label; empty: the first
  std::string subject = "01", task = "touch";  ///< for motion-bids
  bool skip_damaged = false, force = false, json = false;
};
[[nodiscard]] Result<int> run_export(const ExportArguments& arguments, Context& context);

/// One renderer's frames. Skips ticks without a step or with a non-finite HIP.
[[nodiscard]] Result<trace::PathAndTrace> frames_of_recording(device::Recording& recording,
                                                              const std::string& label);

/// Writes everything as datasets of one row a tick, one group per renderer.
[[nodiscard]] Result<std::uint64_t> export_hdf5(device::Recording& recording, const std::string& file,
                                                Progress& progress);
/// True if this program was built with HDF5.
[[nodiscard]] bool has_hdf5();

/// Writes a one-subject dataset in the layout of Motion-BIDS (Brain Imaging Data Structure 1.9 and later)
/// into an empty or new folder: TSV, its JSON, channels, dataset description.
[[nodiscard]] Result<std::uint64_t> export_motion_bids(device::Recording& recording,
                                                       const std::string& folder, const std::string& subject,
                                                       const std::string& task);

// A recording's contents for `palpate info`. They are counted tick by tick without a replay.

/// A latched fault, by name.
struct RecordedFault {
  std::string name;
  std::uint64_t times = 0;  ///< occurrences
  double first_s = 0.0;     ///< after the first tick
};

struct RecordedRendererFacts {
  device::RecordedRenderer renderer;
  std::uint64_t ticks = 0;          ///< ticks with a step
  std::uint64_t contact_ticks = 0;  ///< of these
  std::uint64_t felt_ticks = 0;     ///< ticks in which it was felt or being faded out
  double step_max_us = 0.0;         ///< longest time of its calls in one tick
};

struct RecordingFacts {
  std::string file;
  std::uint64_t bytes = 0;
  device::RecordingHeader header;
  device::RecordingEnd end;
  double length_s = 0.0;              ///< first to last tick, lost stretches included
  std::uint64_t segments = 0;         ///< between two armings of the governor
  double late_max_ms = 0.0;           ///< of the latest tick
  double force_max_n = 0.0;           ///< of the forces sent
  std::vector<RecordedFault> faults;  ///< by first occurrence
  std::vector<std::pair<std::string, std::uint64_t>> decisions;  ///< the mixer's, with their numbers of ticks
  std::vector<RecordedRendererFacts> renderers;
  std::vector<std::string> notes;
  std::optional<StreamFacts> stream{};  ///< of its depth images, or none
};

/// Reads the whole recording: O(bytes), some megabytes of memory. Errors: those of Recording.
[[nodiscard]] Result<RecordingFacts> facts_of_recording(const std::string& file, bool skip_damaged);

/// Format: docs/schemas/info.schema.json.
[[nodiscard]] std::string facts_json(const RecordingFacts& facts);
/// Lines for a terminal, without the control characters of the file's texts.
[[nodiscard]] std::string facts_text(const RecordingFacts& facts);

}  // namespace palpate::experiments
