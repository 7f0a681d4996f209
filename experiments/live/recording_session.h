// The whole of `palpate record`: one renderer under a hand on a device, recorded; and a recording held
// against the renderer that it was made with.
#pragma once

#include <string>

#include "device/record/recording_header.h"
#include "experiments/live/session_device.h"
#include "experiments/session/study_run.h"

namespace palpate::experiments {

struct RecordArguments {
  std::string scene, renderer;
  DeviceArguments device;
  std::string path;  ///< the hand's goal; empty: by the model's size, as long as the session
  std::string traj_columns;
  std::string out;  ///< FILE.palrec
  double seconds = 10.0;
  int rate_hz = 1000;
  std::string flush = "disk";  ///< each chunk: disk or system
  bool accelerated = false;    ///< on a virtual clock, as fast as it goes
  bool force = false, json = false;
  SurfaceArguments surface;
  ModelArguments load;
};
int run_record(const RecordArguments& arguments, Context& context);
/// The same with these drivers.
int run_record_with(const RecordArguments& arguments, const device::Drivers& drivers, Context& context);

/// Whether a recording can be made there; `replace`: of a file that is there. Errors say what to do.
[[nodiscard]] Status check_recording_file(const std::string& file, bool replace);

/// What a recording says of program, machine and scene; device, mapping and time are the session's to add.
[[nodiscard]] device::RecordingHeader recording_header(const std::string& scene, const scene::SceneFile& file,
                                                       const scene::LoadedScene& loaded,
                                                       const SurfaceArguments& surface);

/// What decides what is felt, as one word: models, surfaces, control.
[[nodiscard]] std::string scene_hash(const scene::SceneFile& file, const scene::LoadedScene& scene,
                                     const SurfaceArguments& surface);

/// The renderer around which everything stands that a session puts there: control, moving models. Prepared.
[[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> prepared_renderer(
    const RendererRequest& request, const render::Registry& registry, const scene::LoadedScene& scene,
    int threads, Progress& progress);

/// As it goes into a recording: with every option.
[[nodiscard]] Result<device::RecordedRenderer> recorded_renderer(const RendererRequest& request,
                                                                 const render::Registry& registry);

/// The renderers of a recording; reads all of it.
[[nodiscard]] Result<std::vector<device::RecordedRenderer>> renderers_of_recording(const std::string& file);

/// Replays the recording `arguments.path` through the renderer segment by segment, where it holds one with
/// these options; prints the hashes, and writes them into the folder. The exit status: 1 where the same
/// renderer on the same scene answers otherwise.
int check_recording(const RunArguments& arguments, const std::string& folder, Context& context);

/// The first renderer of a recording as --renderer takes it.
[[nodiscard]] Result<std::string> renderer_of_recording(const std::string& file);

}  // namespace palpate::experiments
