// Declares the parts of `palpate reproduce`.
#pragma once

#include <functional>

#include <palpate/clock.h>
#include "experiments/driver/suite.h"
#include "experiments/report/page.h"
#include "experiments/run/run.h"
#include "experiments/session/session.h"
#include "experiments/tables/manifest.h"

namespace palpate::experiments {

struct ReproduceArguments {
  std::string tables;  ///< "6,7,mine.toml"; empty: all
  std::string out;
  int threads = 0;
  bool full = false;
  bool no_cache = false;     ///< rebuilds reconstructions without storing them
  double mesh_limit_s = -1;  ///< per reconstruction; 0: none; negative: 120, or none with --full
  bool quick = false;        ///< small models and short paths: tests the program, measures nothing
};

/// Runs the tables in order and writes their page. Returns the exit status.
[[nodiscard]] Result<int> reproduce(const ReproduceArguments& arguments, Context& context);

enum class Judged { kNot, kYes, kNo };

/// A line of the first page: what the thesis says beside what is measured.
struct Answer {
  std::string table, page;  ///< "7", "table7.html"
  std::string says, printed;
  std::string literal, ours;      ///< measured: the thesis's algorithm as printed; the same made right
  double ratio = 0.0;             ///< the printed time by that of `ours`; 0: nothing to compare
  std::string error, mesh_error;  ///< of force
  std::string status;
  Judged reproduced{}, as_fast{}, literal_right{}, ours_right{};  ///< `right`: in contact
  std::string take;                                               ///< the renderer to take here; may be empty
};

/// Part of a step in the report.
struct Part {
  std::vector<Known> known;
  std::vector<Section> sections;
  std::vector<Answer> answers;
  std::vector<std::string> missing;  ///< what was not done, with reasons
  bool fell_short = false;           ///< something requested failed
};

struct Step {
  Manifest manifest;
  Part part;
};

/// State shared by the steps.
struct Reproduction {
  const ReproduceArguments& arguments;
  Context& context;
  const Suite& suite;
  const OutputFolder& folder;
  render::Registry registry;
  io::Readers readers;
  metrics::DocumentHead head;
  Stopwatch watch;
  Part part{};                ///< of the step that runs
  std::vector<Step> steps{};  ///< completed
};

/// A model's scene; `stand_in` says why it is a stand-in, where it is one.
struct ModelScene {
  scene::SceneFile file;
  std::string stand_in;
};
/// Scene of a manifest's model: generated, or a scan, fetched if necessary.
[[nodiscard]] Result<ModelScene> scene_of(const ManifestModel& model, Reproduction& r);

/// Time limit of one reconstruction, s; 0: none.
[[nodiscard]] double mesh_limit_s(const Reproduction& r);
/// A renderer with its options, and with that limit where it reconstructs.
[[nodiscard]] Result<RendererRequest> request_of(const std::string& renderer, const Reproduction& r);
/// The manifest's renderers.
[[nodiscard]] Result<std::vector<RendererRequest>> requests_of(const Manifest& manifest,
                                                               const Reproduction& r);
/// Options of a default run, which keeps to minutes: passes, threads, and how long a preparation may take
/// without --full.
[[nodiscard]] RunOptions run_options(const Reproduction& r, double prepare_limit_s);
/// Runs them, and says in the document under which conditions.
[[nodiscard]] Result<std::vector<Run>> run_on(const Stage& stage,
                                              const std::vector<RendererRequest>& requests,
                                              const RunOptions& options, Reproduction& r,
                                              metrics::ResultDocument& document);
/// Writes `text` as `file` of the manifest's folder; reports a failure.
void write_beside(Reproduction& r, const Manifest& manifest, const std::string& file,
                  const std::string& text);

/// Runs a part of the work, or takes over an interrupted run's result with the same key.
void do_step(Reproduction& r, const Manifest& manifest, const std::function<void()>& work);

/// Contents of the report that are no study in the folder; with those the source of report.html.
inline constexpr const char* kReproductionFile = "reproduction.json";
inline constexpr const char* kReproductionTitle = "The thesis's tables, measured again";
[[nodiscard]] std::string reproduction_json(const metrics::DocumentHead& head,
                                            const std::vector<Step>& steps);
/// Draws report.html and its pages of a `palpate reproduce` folder from its files. Error: names the faulty
/// file.
[[nodiscard]] Status draw_reproduction(const OutputFolder& folder);
/// The whole report of these parts.
[[nodiscard]] Page page_of(const metrics::DocumentHead& head, const std::vector<Part>& parts);
/// What follows from the lines: whether the thesis is reproduced, and whom to take.
[[nodiscard]] std::vector<Headline> verdicts_of(const std::vector<Answer>& answers);

/// Takes over warnings and notes, where there are any.
void add_known(Part& part, Known known);
/// Adds a model's loading warnings under its name.
void add_warnings(std::vector<std::string>& warnings, const std::string& model,
                  const scene::LoadedScene& loaded);

/// Reports something missing: a failure if it was requested by name.
void give_up(Reproduction& r, const std::string& what, const Error& error);
/// Whether long runs wait for --full: nobody named the table, and no quick trial makes them short.
[[nodiscard]] bool waits_for_full(const Reproduction& r);
/// Reports something not done, in a line that says why.
void leave_out(Reproduction& r, const std::string& what_and_why);
/// Reports that one of several models is unavailable, which is no failure for the others.
void leave_out(Reproduction& r, const std::string& what, const Error& error);
/// Fails a table that was requested by name and produced nothing.
void check_done(Reproduction& r, bool anything);

/// Table 6: the modified kNN timed as in the thesis, and every builder.
void reproduce_neighbours(const Manifest& manifest, Reproduction& r);
/// Table 3: every reconstruction on every model, beside the printed times.
void reproduce_meshes(const Manifest& manifest, Reproduction& r);
/// Tables 7 to 10, 12 and 13, with comparisons.
void reproduce_frames(const Manifest& manifest, Reproduction& r);
/// A study's part of the report.
[[nodiscard]] Part frames_part(const Manifest& manifest, const Study& study, const OutputFolder& folder);
/// Table 11: every method at the published sizes.
void reproduce_methods(const Manifest& manifest, Reproduction& r);
/// Mean frame and preparation from ten thousand to ten million points.
void reproduce_growth(const Manifest& manifest, Reproduction& r);
/// Ladder, off-vertex and scanner: errors against a hidden truth.
void reproduce_protocol(const Manifest& manifest, Reproduction& r);

/// The thesis's column beside ours, and what is concluded. Pure functions.
[[nodiscard]] Table frames_table(const Manifest& manifest, const metrics::ResultDocument& document);
[[nodiscard]] Answer frames_answer(const Manifest& manifest, const metrics::ResultDocument& document);

}  // namespace palpate::experiments
