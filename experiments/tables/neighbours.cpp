// Table 6, with every neighbour builder for comparison.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "experiments/driver/json_document.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::experiments {
namespace {

constexpr double kMsAMinute = 60000.0, kPercent = 100.0;
// Cells per wall side with --quick.
constexpr std::uint32_t kQuickWall = 40;

std::string whole_ms(double ms) {
  return format_count(static_cast<std::uint64_t>(std::llround(ms)));
}

struct Timed {
  double ms = 0.0;
  search::NeighbourTable table;
};

/// Shortest of three times: disturbances only add.
Timed time_modified(const cloud::Cloud& cloud, int threads, bool complete) {
  constexpr int kRepeats = 3;
  Timed best;
  for (int i = 0; i < kRepeats; ++i) {
    search::ModifiedKnnOptions options;
    options.complete_to_eight = complete;
    const Stopwatch watch;
    search::NeighbourTable table = search::modified_knn(cloud, options, threads);
    const double ms = watch.ms();
    if (i == 0 || ms < best.ms) best.ms = ms;
    best.table = std::move(table);
  }
  return best;
}

struct ModifiedTimes {
  std::string model;
  std::size_t points = 0;
  Timed one, two, printed;  ///< completed to eight links, on one thread and two; as printed, on one
};

std::string agreement_note(const std::string& model, const cloud::Cloud& cloud,
                           const search::NeighbourTable& modified) {
  const Result<search::NeighbourTable> path = search::scanner_path(cloud, 0);
  if (!path) return {};
  const search::Agreement a = search::agreement(*path, modified);
  const auto share = [](std::uint64_t part, std::uint64_t whole) {
    return whole == 0 ? 0.0 : kPercent * static_cast<double>(part) / static_cast<double>(whole);
  };
  return fmt::format(
      "Agreement with the scanner's path on the {}: the same eight neighbours at {} % of the {} points "
      "({} % of the {} interior ones); the thesis claims 100 %.",
      model, format_number(share(a.equal_sets, a.points)), format_count(a.points),
      format_number(share(a.interior_equal, a.interior_points)), format_count(a.interior_points));
}

/// One model's columns in the builders' table.
struct ModelScores {
  std::string model;
  std::string truth;
  std::optional<double> printed_min;
  std::vector<search::BuilderScore> scores;
};

std::vector<search::ThinWall> walls_of(const Manifest& manifest, Reproduction& r) {
  std::vector<search::ThinWall> walls;
  for (const double thickness : manifest.wall_spacings) {
    search::ThinWallOptions options;
    options.thickness_spacings = thickness;
    if (r.arguments.quick) options.across = kQuickWall;
    if (Result<search::ThinWall> wall = search::make_thin_wall(options))
      walls.push_back(*std::move(wall));
    else
      give_up(r, fmt::format("a wall of {} spacings", thickness), wall.error());
  }
  return walls;
}

std::vector<std::string> builder_names() {
  std::vector<std::string> names;
  for (const search::NeighbourBuilder& builder : search::neighbour_builders()) names.push_back(builder.name);
  return names;
}

ModelScores scores_of(const ManifestModel& model, const render::ModelInput& input,
                      const std::vector<search::ThinWall>& walls, Reproduction& r) {
  search::SurfaceNeighbours truth = search::surface_neighbours(*input.cloud, input.original_mesh.get(), 0);
  const std::vector<std::string> all = builder_names();
  const auto waits = [&](const std::string& name) {
    return !r.arguments.full && !r.arguments.quick &&
           std::find(model.slow.begin(), model.slow.end(), name) != model.slow.end();
  };
  std::vector<std::string> names;
  std::remove_copy_if(all.begin(), all.end(), std::back_inserter(names), waits);
  std::vector<search::BuilderScore> scores =
      search::compare_neighbours(names, *input.cloud, truth.table, walls, {}, r.context.progress);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!waits(all[i])) continue;
    search::BuilderScore left_out;
    left_out.builder = all[i];
    left_out.failure = "runs with --full only";
    leave_out(r, fmt::format("{} on the {}: it is slow; run with --full", all[i], model.name));
    scores.insert(scores.begin() + static_cast<std::ptrdiff_t>(i), std::move(left_out));
  }
  return {model.name, std::move(truth.from), model.printed_min, std::move(scores)};
}

/// One row per builder, the thesis's times first.
Table builders_table(const std::vector<ModelScores>& models, const Manifest& manifest) {
  Table table;
  table.title = "All ways to find neighbours";
  table.columns = {"builder"};
  std::vector<Cell> printed = {plain("thesis, modified kNN")};
  for (const ModelScores& m : models) {
    table.columns.insert(table.columns.end(),
                         {m.model + ", 1 thread, ms", "all threads, ms", "true links, %"});
    printed.push_back(plain(m.printed_min ? fmt::format("{:.2f} min", *m.printed_min) : kMissingNumber));
    printed.insert(printed.end(), 2, plain(kMissingNumber));
    table.notes.push_back(fmt::format("True links of the {}: {}.", m.model, m.truth));
  }
  for (const double thickness : manifest.wall_spacings) {
    table.columns.push_back(fmt::format("wall of {:g}", thickness));
    printed.push_back(plain(kMissingNumber));
  }
  table.rows.push_back(std::move(printed));
  for (std::size_t b = 0; !models.empty() && b < models.front().scores.size(); ++b) {
    std::vector<Cell> row = {plain(models.front().scores[b].builder)};
    for (const ModelScores& m : models) {
      if (b >= m.scores.size() || !m.scores[b].failure.empty()) {
        row.insert(row.end(), 3, plain(kMissingNumber));
        continue;
      }
      const search::BuilderScore& s = m.scores[b];
      row.push_back(plain(whole_ms(s.one_thread_ms)));
      row.push_back(plain(s.all_threads_ms ? whole_ms(*s.all_threads_ms) : kMissingNumber));
      row.push_back(plain(format_number(s.agreement.found_percent())));
    }
    const search::BuilderScore& first = models.front().scores[b];
    for (std::size_t w = 0; w < first.walls.size(); ++w)
      row.push_back(plain(first.wall_failures[w].empty() ? format_number(first.walls[w].wrong_percent())
                                                         : kMissingNumber));
    table.rows.push_back(std::move(row));
  }
  table.caption =
      "Every builder with its default options, the best of three. True links: how many of the links along "
      "the "
      "surface were found. Wall of w: percent of links that lead through a slab of w spacings to its other "
      "face. A dash: the builder "
      "needs a scanner's order that the model does not have, knows one thread only, or runs with --full "
      "only.";
  return table;
}

nlohmann::ordered_json builders_json(const std::vector<ModelScores>& models, const Manifest& manifest) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (const ModelScores& m : models)
    for (const search::BuilderScore& s : m.scores) {
      nlohmann::ordered_json row = {{"model", m.model}, {"builder", s.builder}, {"truth", m.truth}};
      if (s.failure.empty()) {
        row["one_thread_ms"] = s.one_thread_ms;
        row["all_threads_ms"] =
            s.all_threads_ms ? nlohmann::ordered_json(*s.all_threads_ms) : nlohmann::ordered_json(nullptr);
        row["links"] = s.agreement.links;
        row["true_links_found_percent"] = s.agreement.found_percent();
        row["notes"] = s.notes;
      } else {
        row["failure"] = s.failure;
      }
      for (std::size_t w = 0; w < s.walls.size(); ++w)
        if (s.wall_failures[w].empty())
          row["walls"].push_back({{"thickness_spacings", manifest.wall_spacings[w]},
                                  {"links", s.walls[w].links},
                                  {"wrong_links", s.walls[w].wrong},
                                  {"points", s.walls[w].points},
                                  {"points_with_wrong_links", s.walls[w].points_wrong}});
      rows.push_back(std::move(row));
    }
  return rows;
}

/// Format: docs/schemas/neighbours.schema.json.
void write_results(const std::vector<ModifiedTimes>& modified, const std::vector<ModelScores>& models,
                   const std::vector<std::string>& warnings, const Manifest& manifest, Reproduction& r) {
  nlohmann::ordered_json document = begin_json("palpate-neighbours/1", r.head);
  document["warnings"] = warnings;
  nlohmann::ordered_json& rows = document["modified_knn"] = nlohmann::ordered_json::array();
  for (const ModifiedTimes& m : modified)
    rows.push_back({{"model", m.model},
                    {"points", m.points},
                    {"completed_one_thread_ms", m.one.ms},
                    {"completed_two_threads_ms", m.two.ms},
                    {"as_printed_one_thread_ms", m.printed.ms}});
  document["builders"] = builders_json(models, manifest);
  write_beside(r, manifest, "neighbours.json",
               document.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

/// A line of the first page.
Answer answer_for(const Manifest& manifest, const ManifestModel& model, const ModifiedTimes& times,
                  bool quick) {
  Answer answer;
  answer.table = fmt::format("{}", manifest.table);
  answer.page = manifest.id() + ".html";
  answer.says = "neighbours of the " + model.name;
  answer.printed = fmt::format("{:g} min, {}", *model.printed_min, manifest.hardware);
  answer.literal = format_duration(times.printed.ms);
  answer.ours = format_duration(times.one.ms);
  answer.status = "tried on a small model only";
  if (quick) return answer;
  answer.ratio = *model.printed_min * kMsAMinute / times.one.ms;
  const bool fast = times.printed.ms <= *model.printed_min * kMsAMinute;
  answer.as_fast = answer.reproduced = fast ? Judged::kYes : Judged::kNo;
  answer.status = fast ? "reproduced" : "not reproduced: slower than printed";
  return answer;
}

}  // namespace

void reproduce_neighbours(const Manifest& manifest, Reproduction& r) {
  std::vector<std::string> warnings;
  std::vector<ModifiedTimes> modified;
  Table table;
  table.title = manifest.title;
  table.columns = {"model",        "points",        "thesis, min",
                   "1 thread, ms", "2 threads, ms", "as printed, 1 thread, ms"};
  std::vector<Headline> found;
  std::vector<ModelScores> models;
  table.notes = manifest.notes;
  for (const ManifestModel& model : manifest.models) {
    const Result<ModelScene> scene = scene_of(model, r);
    const Result<scene::LoadedScene> loaded =
        scene ? scene::load(scene->file, r.readers, {}, r.context.progress)
              : Result<scene::LoadedScene>(scene.error());
    const std::string printed =
        model.printed_min ? fmt::format("{:.2f}", *model.printed_min) : kMissingNumber;
    if (!loaded) {
      table.rows.push_back(
          plain_row({model.name, kMissingNumber, printed, "did not run", kMissingNumber, kMissingNumber}));
      table.rows.back()[3].bad = true;
      leave_out(r, fmt::format("table {}, {}", manifest.table, model.name), loaded.error());
      if (scene) check_done(r, false);
      continue;
    }
    r.context.progress.report("building neighbours of the " + model.name, -1.0);
    add_warnings(warnings, model.name, *loaded);
    const render::ModelInput& input = loaded->input.models.front();
    const cloud::Cloud& cloud = *input.cloud;
    // All models share the same walls.
    if (!waits_for_full(r))
      models.push_back(scores_of(
          model, input, models.empty() ? walls_of(manifest, r) : std::vector<search::ThinWall>{}, r));
    modified.push_back({model.name, cloud.size(), time_modified(cloud, 1, true),
                        time_modified(cloud, 2, true), time_modified(cloud, 1, false)});
    const auto& [name, points, one, two, literal] = modified.back();
    table.rows.push_back(plain_row(
        {name, format_count(points), printed, whole_ms(one.ms), whole_ms(two.ms), whole_ms(literal.ms)}));
    if (const std::string note = agreement_note(name, cloud, two.table); !note.empty())
      table.notes.insert(table.notes.begin(), note);
    if (!model.printed_min) continue;
    r.part.answers.push_back(answer_for(manifest, model, modified.back(), r.arguments.quick));
    found.push_back({fmt::format("{}, {} points", model.name, format_count(cloud.size())),
                     fmt::format("neighbours in {} on one thread, {} on two; the thesis: {} min, {}",
                                 format_duration(one.ms), format_duration(two.ms), printed,
                                 // A quick trial uses a small part of the model.
                                 r.arguments.quick ? std::string("for the whole model")
                                                   : format_number(*model.printed_min * kMsAMinute / one.ms) +
                                                         " times one thread's")});
  }
  if (waits_for_full(r))
    leave_out(r, fmt::format("table {}, the other ways to find neighbours: run with --full", manifest.table));
  check_done(r, !modified.empty());
  table.caption =
      "Thesis: " + manifest.hardware +
      ". Ours: the best of three, completed to eight neighbours; as printed, a point may keep fewer.";
  add_known(r.part, {fmt::format("Table {}", manifest.table), warnings, {}});
  write_results(modified, models, warnings, manifest, r);
  Section section{manifest.id(), manifest.title, {}, {}, {std::move(table)}, {}, {}, std::move(found)};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  if (!models.empty()) section.tables.push_back(builders_table(models, manifest));
  r.part.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
