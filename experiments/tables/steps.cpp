// The steps of `palpate reproduce`: each is kept as soon as it is complete, with all that it has put on the
// page, and the page is drawn again from what is kept.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/session/run_key.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::experiments {
namespace {

/// Every member is written and read: one that is added does not compile here until it is named below.
[[maybe_unused]] void name_all_members(Cell& c, Table& t, Figure& f, Fact& a, Headline& h, HeadlineGroup& g,
                                       Known& k, Section& s) {
  [[maybe_unused]] const auto& [c1, c2, c3] = c;
  [[maybe_unused]] const auto& [t1, t2, t3, t4, t5, t6, t7, t8] = t;
  [[maybe_unused]] const auto& [f1, f2, f3, f4, f5] = f;
  [[maybe_unused]] const auto& [a1, a2] = a;
  [[maybe_unused]] const auto& [h1, h2] = h;
  [[maybe_unused]] const auto& [g1, g2] = g;
  [[maybe_unused]] const auto& [k1, k2, k3] = k;
  [[maybe_unused]] const auto& [s1, s2, s3, s4, s5, s6, s7] = s;
}

}  // namespace

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Cell, text, best, bad)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Table, title, caption, columns, rows, notes, turns, best_means, bad_means)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figure, name, title, caption, svg, wide)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Fact, about, sentences)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Headline, lead, text)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(HeadlineGroup, title, lines)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Known, about, warnings, notes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Section, id, title, opening, paragraphs, tables, figures, facts)

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Yield, known, headlines, sections, tables, missing, stand_ins, fell_short)

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kSchema = "palpate-reproduction/1";

template <class J>
std::string text_of(const J& json, int indent) {
  return json.dump(indent, ' ', false, J::error_handler_t::replace);
}

/// The lists that a step adds to, and how long they were before.
template <class T>
std::vector<T> added(const std::vector<T>& all, std::size_t before) {
  return {all.begin() + static_cast<std::ptrdiff_t>(before), all.end()};
}
template <class T>
void add(std::vector<T>& all, const std::vector<T>& more) {
  all.insert(all.end(), more.begin(), more.end());
}

void add_to_page(Page& page, const Yield& step) {
  add(page.known, step.known);
  add(page.headlines, step.headlines);
  add(page.sections, step.sections);
}

bool add_kept(const std::string& text, const Manifest& manifest, Reproduction& r) {
  try {
    const Yield step = nlohmann::json::parse(text).get<Yield>();
    add_to_page(r.page, step);
    add(r.tables, step.tables);
    add(r.missing, step.missing);
    add(r.stand_ins, step.stand_ins);
    r.fell_short = r.fell_short || step.fell_short;
    r.steps.push_back({manifest, step});
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

/// Whether the step's part of the page is drawn from its study.
bool has_study(const Step& step) {
  return step.manifest.kind == Manifest::Kind::kFrames && !step.yield.sections.empty();
}

metrics::DocumentHead head_from(const Json& document) {
  metrics::DocumentHead head;
  document.at("version").get_to(head.version);
  document.at("commit").get_to(head.commit);
  document.at("build").get_to(head.build);
  const Json& machine = document.at("machine");
  metrics::visit_machine([&](const char* key, auto& value) { machine.at(key).get_to(value); }, head.machine);
  document.at("started_utc").get_to(head.started_utc);
  document.at("command").get_to(head.command);
  return head;
}

/// One step onto the page again: from its study, or from what is kept of it and the figures' own scripts.
Status draw_step(Page& page, const Json& step, std::vector<std::string>& missing,
                 const OutputFolder& folder) {
  Yield yield = step.at("page").get<Yield>();
  add(missing, yield.missing);
  if (!step.at("study").get<bool>()) {
    const Result<OutputFolder> figures = folder.inside("figures");
    if (!figures) return figures.error();
    for (Section& section : yield.sections)
      for (Figure& figure : section.figures)
        if (!figure.svg.empty()) figure = drawn_again(std::move(figure), *figures);
    add_to_page(page, yield);
    return Done{};
  }
  const std::string file = folder.file(kReproductionFile).string();
  const Result<Manifest> manifest = parse_manifest(step.at("manifest").get<std::string>(), file);
  if (!manifest) return manifest.error();
  const Result<Study> study = read_study(folder.file(manifest->id()));
  if (!study) return study.error();
  add_frames(page, *manifest, *study, folder);
  return Done{};
}

}  // namespace

std::string reproduction_json(const std::string& title, const metrics::DocumentHead& head,
                              const std::vector<Step>& steps) {
  Json document = {{"schema", kSchema}};
  document.update(Json::parse(metrics::head_json(head)));
  document["title"] = title;
  document["steps"] = Json::array();
  for (const Step& step : steps) {
    Yield yield = step.yield;
    // What stands in the folder already is not said twice.
    if (has_study(step)) yield = {{}, {}, {}, {}, yield.missing, yield.stand_ins, yield.fell_short};
    for (Section& section : yield.sections)
      for (Figure& figure : section.figures)
        if (!figure.svg.empty()) figure.svg = "figures/" + figure.name + ".gp";
    document["steps"].push_back({{"id", step.manifest.id()},
                                 {"manifest", step.manifest.source},
                                 {"study", has_study(step)},
                                 {"page", Json(nlohmann::json(yield))}});
  }
  return text_of(document, 1) + "\n";
}

Status draw_reproduction(const OutputFolder& folder) {
  const std::string file = folder.file(kReproductionFile).string();
  const Result<std::string> text = read_file(file, kMemoryLimitBytes);
  if (!text) return text.error();
  try {
    const Json document = Json::parse(*text);
    if (document.at("schema") != kSchema)
      return Error{"is not of the schema " + std::string(kSchema), "run reproduce again", file, 0};
    Page page = begin_page(document.at("title").get<std::string>(), head_from(document));
    std::vector<std::string> missing;
    for (const Json& step : document.at("steps")) PALPATE_TRY(draw_step(page, step, missing, folder));
    finish_page(page, missing);
    return write_page(page, folder);
  } catch (const nlohmann::json::exception& error) {
    return Error{fmt::format("is not what reproduce writes: {}", error.what()), "run reproduce again", file,
                 0};
  }
}

void finish_page(Page& page, const std::vector<std::string>& missing) {
  HeadlineGroup group{"Not done", {}};
  for (const std::string& what : missing) group.lines.push_back({"", what});
  if (!group.lines.empty()) page.headlines.push_back(std::move(group));
  page.commands.push_back("palpate reproduce --help    # shorter and longer runs");
}

void do_step(Reproduction& r, const Manifest& manifest, const std::function<void()>& work) {
  const std::string name = manifest.id(), key = RunKey().add(manifest.source).word();
  if (r.folder.take_over(name, key, [&](const std::string& text) { return add_kept(text, manifest, r); }))
    return;
  const std::size_t known = r.page.known.size(), headlines = r.page.headlines.size(),
                    sections = r.page.sections.size(), tables = r.tables.size(), missing = r.missing.size(),
                    stand_ins = r.stand_ins.size();
  const bool fell_short = std::exchange(r.fell_short, false);
  r.folder.start_part();
  work();
  Yield step = {added(r.page.known, known),
                added(r.page.headlines, headlines),
                added(r.page.sections, sections),
                added(r.tables, tables),
                added(r.missing, missing),
                added(r.stand_ins, stand_ins),
                r.fell_short};
  r.fell_short = r.fell_short || fell_short;
  const bool came = !step.sections.empty();  // else the next run tries again
  const std::string text = text_of(nlohmann::json(step), -1);
  r.steps.push_back({manifest, std::move(step)});
  if (!came) return;
  if (const Status kept = r.folder.keep(name, key, text); !kept) give_up(r, name, kept.error());
}

}  // namespace palpate::experiments
