// The parts of `palpate reproduce`.
#pragma once

#include <functional>
#include <map>
#include <memory>

#include "experiments/report/page.h"
#include "experiments/run/run.h"
#include "experiments/session/session.h"
#include "experiments/tables/manifest.h"
#include "toolkit/core/clock.h"

namespace palpate::experiments {

struct ReproduceArguments {
  std::string tables;  ///< "6,7,mine.toml"; empty: all there are
  std::string out;
  int threads = 0;
  bool full = false;
  bool no_cache = false;     ///< reconstructions are made anew, and not kept
  double mesh_limit_s = -1;  ///< of one reconstruction; 0: none; negative: 120, and none with --full
  bool quick = false;        ///< small models and short paths: a trial of the machinery, no measurement
};

/// The tables, one after the other, and the page of them all. The exit status.
int reproduce(const ReproduceArguments& arguments, Context& context);

/// What one step has put on the page.
struct Yield {
  std::vector<Known> known;
  std::vector<HeadlineGroup> headlines;
  std::vector<Section> sections;
  std::vector<Table> tables;
  std::vector<std::string> missing, stand_ins;
  bool fell_short = false;
};

struct Step {
  Manifest manifest;
  Yield yield;
};

/// What the parts share.
struct Reproduction {
  const ReproduceArguments& arguments;
  Context& context;
  const OutputFolder& folder;
  render::Registry registry;
  io::Readers readers;
  Page page;
  std::vector<Table> tables;           ///< in the order they are printed at the end
  std::vector<std::string> missing;    ///< what could not be done, and why
  std::vector<std::string> stand_ins;  ///< models that ran as stand-ins, and why
  bool fell_short = false;             ///< something that was asked for failed
  Stopwatch watch;
  std::vector<Step> steps{};  ///< that are done
};

/// The scene of a manifest's model: generated, or a scan found or fetched.
[[nodiscard]] Result<scene::SceneFile> scene_of(const ManifestModel& model, Reproduction& r);

/// How long one reconstruction may take, s; 0: no limit.
[[nodiscard]] double mesh_limit_s(const Reproduction& r);
/// The same for a renderer that reconstructs; any other stays as it is.
void limit_reconstruction(RendererRequest& request, const Reproduction& r);

/// How often frames are timed, so that a run by default keeps to its ten minutes.
void set_passes(RunOptions& options, const Reproduction& r);

/// Does a part of the work, or takes over what an interrupted run has kept of it under the same key.
void do_step(Reproduction& r, const Manifest& manifest, const std::function<void()>& work);

/// All that is on the page and does not stand in the folder as a study: what report.html is drawn from.
inline constexpr const char* kReproductionFile = "reproduction.json";
[[nodiscard]] std::string reproduction_json(const std::string& title, const metrics::DocumentHead& head,
                                            const std::vector<Step>& steps);
/// report.html of a folder that `palpate reproduce` has written, drawn from it and put into it. What is wrong
/// with the folder is an Error that names the file.
[[nodiscard]] Status draw_reproduction(const OutputFolder& folder);
/// The same page, before it is drawn.
void finish_page(Page& page, const std::vector<std::string>& missing);

/// What was doubtful in loading a model goes with the results, under the model's name.
void add_warnings(std::vector<std::string>& warnings, const std::string& model,
                  const scene::LoadedScene& loaded);

/// Says what is missing. It is a failure only where it was asked for by name.
void give_up(Reproduction& r, const std::string& what, const Error& error);
/// Says that one of several models could not be had: no failure of what was done on the others.
void leave_out(Reproduction& r, const std::string& what, const Error& error);
/// Unless anything was done of a table that was asked for by name, that is a failure.
void check_done(Reproduction& r, bool anything);

/// Table 6: the modified kNN as the thesis timed it, and every builder beside it.
void reproduce_neighbours(const Manifest& manifest, Reproduction& r);
/// Table 3: every reconstruction on every model, beside the printed times.
void reproduce_meshes(const Manifest& manifest, Reproduction& r);
/// Tables 7 and 9, each with its comparison.
void reproduce_frames(const Manifest& manifest, Reproduction& r);
/// What the study in the folder puts on the page; the table beside the thesis's is the answer.
Table add_frames(Page& page, const Manifest& manifest, const Study& study, const OutputFolder& folder);
/// Table 11: every method at the sizes at which they were published.
void reproduce_methods(const Manifest& manifest, Reproduction& r);
/// Mean frame and preparation from ten thousand to ten million points.
void reproduce_growth(const Manifest& manifest, Reproduction& r);
/// Ladder, off-vertex and scanner: error against a truth that no renderer sees.
void reproduce_protocol(const Manifest& manifest, Reproduction& r);

/// The thesis's column beside ours. A pure function of manifest and results.
[[nodiscard]] Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document);

}  // namespace palpate::experiments
