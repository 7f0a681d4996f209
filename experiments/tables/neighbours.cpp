// Table 6, and every way to find neighbours beside it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "experiments/tables/reproduction.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/neighbourhood/compare.h"
#include "toolkit/neighbourhood/knn.h"

namespace palpate::experiments {
namespace {

constexpr double kMsAMinute = 60000.0, kPercent = 100.0;
// Cells a side of a wall in a quick trial.
constexpr std::uint32_t kQuickWall = 40;

std::string whole_ms(double ms) {
  return count_text(static_cast<std::uint64_t>(std::llround(ms)));
}

struct Timed {
  double ms = 0.0;
  neighbourhood::NeighbourTable table;
};

/// The best of three: what else the machine does only adds.
Timed time_modified(const cloud::Cloud& cloud, int threads, bool complete) {
  constexpr int kRepeats = 3;
  Timed best;
  for (int i = 0; i < kRepeats; ++i) {
    neighbourhood::ModifiedKnnOptions options;
    options.complete_to_eight = complete;
    const Stopwatch watch;
    neighbourhood::NeighbourTable table = neighbourhood::modified_knn(cloud, options, threads);
    const double ms = watch.ms();
    if (i == 0 || ms < best.ms) best.ms = ms;
    best.table = std::move(table);
  }
  return best;
}

/// The modified kNN on one model.
struct ModifiedTimes {
  std::string model;
  std::size_t points = 0;
  Timed one, two, printed;  ///< completed to eight on one thread and on two; as printed, on one
};

std::string agreement_note(const std::string& model, const cloud::Cloud& cloud,
                           const neighbourhood::NeighbourTable& modified) {
  const Result<neighbourhood::NeighbourTable> path = neighbourhood::scanner_path(cloud, 0);
  if (!path) return {};
  const neighbourhood::Agreement a = neighbourhood::agreement(*path, modified);
  const auto share = [](std::uint64_t part, std::uint64_t whole) {
    return whole == 0 ? 0.0 : kPercent * static_cast<double>(part) / static_cast<double>(whole);
  };
  return fmt::format(
      "Agreement with the scanner's path on the {}: the same eight neighbours at {} % of the {} points "
      "({} % of the {} interior ones); the thesis claims 100 %.",
      model, short_number(share(a.equal_sets, a.points)), count_text(a.points),
      short_number(share(a.interior_equal, a.interior_points)), count_text(a.interior_points));
}

/// Columns of the table of builders that are about one model.
struct ModelScores {
  std::string model;
  std::string truth;
  std::optional<double> printed_min;
  std::vector<neighbourhood::BuilderScore> scores;
};

std::vector<neighbourhood::ThinWall> walls_of(const Manifest& manifest, Reproduction& r) {
  std::vector<neighbourhood::ThinWall> walls;
  for (const double thickness : manifest.wall_spacings) {
    neighbourhood::ThinWallOptions options;
    options.thickness_spacings = thickness;
    if (r.arguments.quick) options.across = kQuickWall;
    if (Result<neighbourhood::ThinWall> wall = neighbourhood::make_thin_wall(options))
      walls.push_back(*std::move(wall));
    else
      give_up(r, fmt::format("a wall of {} spacings", thickness), wall.error());
  }
  return walls;
}

std::vector<std::string> builder_names() {
  std::vector<std::string> names;
  for (const neighbourhood::Builder& builder : neighbourhood::builders()) names.push_back(builder.name);
  return names;
}

ModelScores scores_of(const ManifestModel& model, const render::ModelInput& input,
                      const std::vector<neighbourhood::ThinWall>& walls, Reproduction& r) {
  neighbourhood::SurfaceNeighbours truth =
      neighbourhood::surface_neighbours(*input.cloud, input.original_mesh.get(), 0);
  const std::vector<std::string> all = builder_names();
  const auto waits = [&](const std::string& name) {
    return !r.arguments.full && !r.arguments.quick &&
           std::find(model.slow.begin(), model.slow.end(), name) != model.slow.end();
  };
  std::vector<std::string> names;
  std::remove_copy_if(all.begin(), all.end(), std::back_inserter(names), waits);
  std::vector<neighbourhood::BuilderScore> scores =
      neighbourhood::compare_neighbours(names, *input.cloud, truth.table, walls, {}, r.context.progress);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!waits(all[i])) continue;
    neighbourhood::BuilderScore left_out;
    left_out.builder = all[i];
    left_out.failure = "runs with --full only";
    r.missing.push_back(fmt::format("{} on the {}: it is slow; run with --full", all[i], model.name));
    scores.insert(scores.begin() + static_cast<std::ptrdiff_t>(i), std::move(left_out));
  }
  return {model.name, std::move(truth.from), model.printed_min, std::move(scores)};
}

/// One row a builder, the thesis's own times first.
Table builders_table(const std::vector<ModelScores>& models, const Manifest& manifest) {
  Table table;
  table.title = "All ways to find neighbours";
  table.columns = {"builder"};
  std::vector<Cell> printed = {plain("thesis, modified kNN")};
  for (const ModelScores& m : models) {
    table.columns.insert(table.columns.end(),
                         {m.model + ", 1 thread, ms", "all threads, ms", "true links, %"});
    printed.push_back(plain(m.printed_min ? fmt::format("{:.2f} min", *m.printed_min) : kNoNumber));
    printed.insert(printed.end(), 2, plain(kNoNumber));
    table.notes.push_back(fmt::format("True links of the {}: {}.", m.model, m.truth));
  }
  for (const double thickness : manifest.wall_spacings) {
    table.columns.push_back(fmt::format("wall of {:g}", thickness));
    printed.push_back(plain(kNoNumber));
  }
  table.rows.push_back(std::move(printed));
  for (std::size_t b = 0; !models.empty() && b < models.front().scores.size(); ++b) {
    std::vector<Cell> row = {plain(models.front().scores[b].builder)};
    for (const ModelScores& m : models) {
      if (b >= m.scores.size() || !m.scores[b].failure.empty()) {
        row.insert(row.end(), 3, plain(kNoNumber));
        continue;
      }
      const neighbourhood::BuilderScore& s = m.scores[b];
      row.push_back(plain(whole_ms(s.one_thread_ms)));
      row.push_back(plain(s.all_threads_ms ? whole_ms(*s.all_threads_ms) : kNoNumber));
      row.push_back(plain(short_number(s.agreement.found_percent())));
    }
    const neighbourhood::BuilderScore& first = models.front().scores[b];
    for (std::size_t w = 0; w < first.walls.size(); ++w)
      row.push_back(
          plain(first.wall_failures[w].empty() ? short_number(first.walls[w].wrong_percent()) : kNoNumber));
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
    for (const neighbourhood::BuilderScore& s : m.scores) {
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

/// docs/neighbours.schema.json describes it.
void write_results(const std::vector<ModifiedTimes>& modified, const std::vector<ModelScores>& models,
                   const std::vector<std::string>& warnings, const Manifest& manifest, Reproduction& r) {
  nlohmann::ordered_json document = {{"schema", "palpate-neighbours/1"}};
  document.update(nlohmann::ordered_json::parse(metrics::head_json(r.page.about)));
  document["warnings"] = warnings;
  nlohmann::ordered_json& rows = document["modified_knn"] = nlohmann::ordered_json::array();
  for (const ModifiedTimes& m : modified)
    rows.push_back({{"model", m.model},
                    {"points", m.points},
                    {"completed_one_thread_ms", m.one.ms},
                    {"completed_two_threads_ms", m.two.ms},
                    {"as_printed_one_thread_ms", m.printed.ms}});
  document["builders"] = builders_json(models, manifest);
  const Result<OutputFolder> folder = r.folder.inside(fmt::format("table{}", manifest.table));
  const std::string text = document.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  const Status written = folder ? folder->write("neighbours.json", text + "\n") : Status(folder.error());
  if (!written) give_up(r, fmt::format("the results of table {}", manifest.table), written.error());
}

}  // namespace

void reproduce_neighbours(const Manifest& manifest, Reproduction& r) {
  std::vector<std::string> warnings;
  std::vector<ModifiedTimes> modified;
  Table table;
  table.title = manifest.title;
  table.columns = {"model",        "points",        "thesis, min",
                   "1 thread, ms", "2 threads, ms", "as printed, 1 thread, ms"};
  HeadlineGroup found{manifest.title, {}};
  std::vector<ModelScores> models;
  table.notes = manifest.notes;
  for (const ManifestModel& model : manifest.models) {
    Result<scene::SceneFile> scene = scene_of(model, r);
    const Result<scene::LoadedScene> loaded = scene ? scene::load(*scene, r.readers, {}, r.context.progress)
                                                    : Result<scene::LoadedScene>(scene.error());
    const std::string printed = model.printed_min ? fmt::format("{:.2f}", *model.printed_min) : kNoNumber;
    if (!loaded) {
      table.rows.push_back({plain(model.name),
                            plain(kNoNumber),
                            plain(printed),
                            {"did not run", false, true},
                            plain(kNoNumber),
                            plain(kNoNumber)});
      (scene ? give_up : leave_out)(r, fmt::format("table {}, {}", manifest.table, model.name),
                                    loaded.error());
      continue;
    }
    r.context.progress.report("building neighbours of the " + model.name, -1.0);
    add_warnings(warnings, model.name, *loaded);
    const render::ModelInput& input = loaded->input.models.front();
    const cloud::Cloud& cloud = *input.cloud;
    // The walls are the same for every model.
    models.push_back(scores_of(
        model, input, models.empty() ? walls_of(manifest, r) : std::vector<neighbourhood::ThinWall>{}, r));
    modified.push_back({model.name, cloud.size(), time_modified(cloud, 1, true),
                        time_modified(cloud, 2, true), time_modified(cloud, 1, false)});
    const auto& [name, points, one, two, literal] = modified.back();
    table.rows.push_back({plain(name), plain(count_text(points)), plain(printed), plain(whole_ms(one.ms)),
                          plain(whole_ms(two.ms)), plain(whole_ms(literal.ms))});
    if (const std::string note = agreement_note(name, cloud, two.table); !note.empty())
      table.notes.insert(table.notes.begin(), note);
    if (model.printed_min)
      found.lines.push_back(
          {fmt::format("{}, {} points", model.name, count_text(cloud.size())),
           fmt::format("neighbours in {} on one thread, {} on two; the thesis: {} min, {}",
                       duration_text(one.ms), duration_text(two.ms), printed,
                       // A quick trial takes a small part of the model.
                       r.arguments.quick ? std::string("for the whole model")
                                         : short_number(*model.printed_min * kMsAMinute / one.ms) +
                                               " times one thread's")});
  }
  check_done(r, !models.empty());
  r.page.headlines.push_back(std::move(found));
  table.caption =
      "Thesis: " + manifest.hardware +
      ". Ours: the best of three, completed to eight neighbours; as printed, a point may keep fewer.";
  add_known(r.page, {fmt::format("Table {}", manifest.table), warnings, {}});
  write_results(modified, models, warnings, manifest, r);
  Section section{fmt::format("table{}", manifest.table), manifest.title, {}, {}, {table}, {}, {}};
  if (!manifest.text.empty()) section.paragraphs.push_back(manifest.text);
  r.tables.push_back(std::move(table));
  if (!models.empty()) {
    section.tables.push_back(builders_table(models, manifest));
    r.tables.push_back(section.tables.back());
  }
  r.page.sections.push_back(std::move(section));
}

}  // namespace palpate::experiments
