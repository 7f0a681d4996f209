// A run of renderers along one path, for compare.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "experiments/driver/suite.h"
#include "experiments/run/run.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct RunArguments {
  std::string scene;
  std::string stream, stream_delay;  ///< depth images in the place of a scene; empty: none
  std::string renderers;             ///< separated by commas
  bool one = false;                  ///< where none is named: the scene's or the plan's alone
  std::string path;
  std::string out;
  ModelArguments load;
  SurfaceArguments surface;
  std::string reference = "auto";
  std::uint64_t paced = 0;
  std::uint64_t passes = kUsualPasses;
  double budget_s = kUsualBudgetS;
  std::string save_mesh;
  std::string save_edited;
  bool force = false;          ///< of the two files above
  bool allow_missing = false;  ///< renderers that lack what the scene asks for run too, and are marked
  bool json = false;
};

/// Stage and renderers of the arguments.
struct CheckedRun {
  StageRequest stage;
  std::vector<RendererRequest> renderers;  ///< that were named
  std::optional<RendererRequest> own;      ///< the scene's, where none was named
};
/// The scene, or the stream that stands for it, as the user wrote it.
[[nodiscard]] inline const std::string& scene_or_stream(const RunArguments& arguments) {
  return arguments.stream.empty() ? arguments.scene : arguments.stream;
}
/// Everything that can be wrong with the arguments is found here, before anything is made or loaded.
[[nodiscard]] Result<CheckedRun> check_run(const RunArguments& arguments, const render::Registry& registry,
                                           Progress& progress);

/// Opens the folder that was asked for, or the usual one of `command` (arguments.h).
[[nodiscard]] Status open_folder(const RunArguments& arguments, const char* command,
                                 const StageRequest& stage, Suite& suite);

/// Open arguments are chosen now that the models are known (arguments.h), `one` or several; notes say why.
/// Error: one lacks what the scene asks for.
[[nodiscard]] Status choose_renderers(bool one, const render::Registry& registry,
                                      const render::SceneInput& scene, CheckedRun& checked,
                                      std::vector<std::string>& notes);

/// Everything that the results of every renderer depend on.
[[nodiscard]] RunKey key_of(const RunArguments& arguments, const StageRequest& stage);

/// Called when all files of the study are written: makes more files, returns what to print.
using AfterStudy = std::function<Result<std::string>(const OutputFolder& folder)>;

/// Checks every argument before any work, runs the renderers, writes the files, prints a summary. The exit
/// status. Open arguments are chosen by the model (arguments.h), and reported before the run.
[[nodiscard]] Result<int> run_study(const RunArguments& arguments, Context& context, const AfterStudy& after);

}  // namespace palpate::experiments
