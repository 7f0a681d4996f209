// The subcommands: plain arguments in, exit status out. main.cpp alone knows how they are written on a
// command line.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/command/progress_bar.h"
#include "experiments/run/surface_keys.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

inline constexpr int kExitOk = 0;
inline constexpr int kExitFellShort = 1;  ///< ran, and failed or fell short
inline constexpr int kExitBadInput = 2;   ///< bad arguments or input

/// What all commands that load a model take.
struct ModelArguments {
  std::string unit;              ///< empty: as the file says
  double scale = 0.0;            ///< 0: as the scene says
  double post_mm = 0.0;          ///< height grids: distance of posts; 0: as the file says
  double vertical_mm = 0.0;      ///< height grids: mm of 1; 0: the unit
  std::string non_finite;        ///< drop, refuse; empty: drop
  double memory_limit_gb = 0.0;  ///< of reading one file; 0: kMemoryLimitBytes
  int threads = 0;               ///< 0 = all
};

struct InfoArguments {
  std::string model;
  ModelArguments load;
  bool json = false;
};
struct PlanArguments {
  std::string scene;
  std::string renderer;  ///< empty: the scene's, or the plan's own choice
  ModelArguments load;
  SurfaceArguments surface;
  bool json = false;
};
struct CleanArguments {
  std::string model;  ///< empty: list the steps
  std::string steps;
  std::string out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};
struct RenderersArguments {
  std::string name;  ///< empty: all
  bool json = false;
};
struct PathsArguments {
  std::string name;  ///< empty: all
  bool json = false;
};
/// replay and compare.
struct RunArguments {
  std::string scene;
  std::string renderers;  ///< one for replay, separated by commas for compare
  std::string path;
  std::string traj_columns;  ///< of a recorded path; empty: as `path` says
  std::string out;
  ModelArguments load;
  SurfaceArguments surface;
  std::string reference = "auto";
  std::uint64_t paced = 0;
  std::string save_mesh;
  std::string save_edited;
  bool force = false;          ///< of the two files above
  bool allow_missing = false;  ///< renderers that lack what the scene asks for run too, and are marked
  bool json = false;
};
/// report and score.
struct StudyArguments {
  std::string folder;
  bool json = false;  ///< of score
};
struct ReproduceArguments {
  std::string tables;  ///< "6,7,9"; empty: all there are
  std::string out;
  int threads = 0;
  bool full = false;
  bool no_cache = false;     ///< reconstructions are made anew, and not kept
  double mesh_limit_s = -1;  ///< of one reconstruction; 0: none; negative: 120, and none with --full
  bool quick = false;        ///< small models and short paths: a trial of the machinery, no measurement
};
struct BehavioursArguments {
  std::string renderers;  ///< empty: all methods
  std::string only;       ///< "thin-plate,ridge"; empty: all
  std::string out;
  int threads = 0;
  bool json = false;
};
struct FetchArguments {
  std::string name;            ///< empty: list
  std::string source;          ///< an address to take it from instead
  double size_limit_gb = 0.0;  ///< of the download; 0: kDownloadLimitBytes
  bool force = false;          ///< fetched though it is here
  bool json = false;
};

/// What every command gets.
struct Context {
  ProgressBar& progress;
  std::string command_line;  ///< as typed, quoted where needed
};

int run_info(const InfoArguments& arguments, Context& context);
int run_plan(const PlanArguments& arguments, Context& context);
int run_clean(const CleanArguments& arguments, Context& context);
int run_renderers(const RenderersArguments& arguments);
int run_paths(const PathsArguments& arguments);
int run_replay(const RunArguments& arguments, Context& context);
int run_compare(const RunArguments& arguments, Context& context);
int run_report(const StudyArguments& arguments, Context& context);
int run_score(const StudyArguments& arguments, Context& context);
int run_reproduce(const ReproduceArguments& arguments, Context& context);
int run_behaviours_command(const BehavioursArguments& arguments, Context& context);
int run_fetch(const FetchArguments& arguments, Context& context);

/// Prints "palpate: error: ..." and returns `status`.
int fail(const Error& error, int status, ProgressBar* progress = nullptr);

}  // namespace palpate::experiments
