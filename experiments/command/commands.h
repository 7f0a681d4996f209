// The subcommands: plain arguments in, exit status out. main.cpp alone knows how they are written on a
// command line.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/command/progress_bar.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

inline constexpr int kExitOk = 0;
inline constexpr int kExitFellShort = 1;  ///< ran, and failed or fell short
inline constexpr int kExitBadInput = 2;   ///< bad arguments or input

/// What all commands that load a model take.
struct ModelArguments {
  std::string unit;                 ///< empty: as the file says
  double scale = 0.0;               ///< 0: as the scene says
  double post_mm = 0.0;             ///< height grids: distance of posts; 0: as the file says
  double vertical_mm = 0.0;         ///< height grids: mm of 1; 0: the unit
  std::string non_finite = "drop";  ///< drop, refuse
  int threads = 0;                  ///< 0 = all
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
  bool json = false;
};
struct CleanArguments {
  std::string model;  ///< empty: list the steps
  std::string steps;
  std::string out;
  ModelArguments load;
  bool json = false;
};
struct RenderersArguments {
  bool json = false;
};
/// replay and compare.
struct RunArguments {
  std::string scene;
  std::string renderers;  ///< one for replay, separated by commas for compare
  std::string path;
  std::string out;
  ModelArguments load;
  std::string reference = "auto";
  std::uint64_t paced = 0;
  std::string save_mesh;
  std::string save_edited;
  bool json = false;
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
  std::string name;    ///< empty: list
  std::string source;  ///< an address to take it from instead
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
int run_replay(const RunArguments& arguments, Context& context);
int run_compare(const RunArguments& arguments, Context& context);
int run_reproduce(const ReproduceArguments& arguments, Context& context);
int run_behaviours_command(const BehavioursArguments& arguments, Context& context);
int run_fetch(const FetchArguments& arguments, Context& context);

/// Prints "palpate: error: ..." and returns `status`.
int fail(const Error& error, int status, ProgressBar* progress = nullptr);

}  // namespace palpate::experiments
