// Steps of `palpate reproduce`. Each is stored when complete, with its part of the report, and the report is
// drawn again from storage.
#include <fmt/format.h>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/files.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::experiments {
namespace {

/// Fails to compile when a member is added: store and read it below, then count it here.
[[maybe_unused]] void name_all_members(Cell& c, Table& t, Figure& f, Fact& a, Headline& h, Known& k,
                                       Section& s, Answer& w, Part& p) {
  [[maybe_unused]] const auto& [c1, c2, c3, c4] = c;
  [[maybe_unused]] const auto& [t1, t2, t3, t4, t5, t6, t7, t8] = t;
  [[maybe_unused]] const auto& [f1, f2, f3, f4, f5] = f;
  [[maybe_unused]] const auto& [a1, a2] = a;
  [[maybe_unused]] const auto& [h1, h2] = h;
  [[maybe_unused]] const auto& [k1, k2, k3] = k;
  [[maybe_unused]] const auto& [s1, s2, s3, s4, s5, s6, s7, s8] = s;
  [[maybe_unused]] const auto& [w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12, w13, w14, w15] = w;
  [[maybe_unused]] const auto& [p1, p2, p3, p4, p5] = p;
}

}  // namespace

// With defaults: documents of earlier versions lack what came later.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Cell, text, best, bad, link)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Table, title, caption, columns, rows, notes, turns, best_means, bad_means)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figure, name, title, caption, svg, wide)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Fact, about, sentences)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Headline, lead, text)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Known, about, warnings, notes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Section, id, title, opening, paragraphs, tables, figures,
                                                facts, found)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Answer, table, page, says, printed, literal, ours, ratio, error,
                                   mesh_error, status, reproduced, as_fast, literal_right, ours_right, take)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Part, known, sections, answers, missing, fell_short)

std::string to_text(const Part& part) {
  return to_line(part);
}
bool from_text(const std::string& text, Part& part) {
  return from_line(text, part);
}

namespace {

constexpr const char* kSchema = "palpate-reproduction/1";

/// True if the step's part is drawn from its study.
bool has_study(const Step& step) {
  return step.manifest.kind == Manifest::Kind::kFrames && !step.part.sections.empty();
}

metrics::DocumentHead head_from(const DocumentJson& document) {
  metrics::DocumentHead head;
  document.at("version").get_to(head.version);
  document.at("commit").get_to(head.commit);
  document.at("build").get_to(head.build);
  const DocumentJson& machine = document.at("machine");
  metrics::visit_machine([&](const char* key, auto& value) { machine.at(key).get_to(value); }, head.machine);
  document.at("started_utc").get_to(head.started_utc);
  document.at("command").get_to(head.command);
  return head;
}

/// A step's part again: from its study, or from storage and the figures' scripts.
Result<Part> part_again(const DocumentJson& step, const OutputFolder& folder) {
  Part part = step.at("page").get<Part>();
  if (!step.at("study").get<bool>()) {
    PALPATE_ASSIGN(const OutputFolder figures, folder.inside("figures"));
    for (Section& section : part.sections)
      for (Figure& figure : section.figures)
        if (!figure.svg.empty()) figure = drawn_again(std::move(figure), figures);
    return part;
  }
  PALPATE_ASSIGN(const Manifest manifest, parse_manifest(step.at("manifest").get<std::string>(),
                                                         folder.file(kReproductionFile).string()));
  PALPATE_ASSIGN(const Study study, read_study(folder.file(manifest.id())));
  Part drawn = frames_part(manifest, study, folder);
  drawn.missing = std::move(part.missing);
  return drawn;
}

}  // namespace

std::string reproduction_json(const metrics::DocumentHead& head, const std::vector<Step>& steps) {
  DocumentJson document = begin_json(kSchema, head);
  document["title"] = kReproductionTitle;
  document["steps"] = DocumentJson::array();
  for (const Step& step : steps) {
    Part part = step.part;
    // Files in the folder provide these parts.
    if (has_study(step)) part = {{}, {}, {}, part.missing, part.fell_short};
    for (Section& section : part.sections)
      for (Figure& figure : section.figures)
        if (!figure.svg.empty()) figure.svg = "figures/" + figure.name + ".gp";
    document["steps"].push_back({{"id", step.manifest.id()},
                                 {"manifest", step.manifest.source},
                                 {"study", has_study(step)},
                                 {"page", DocumentJson(nlohmann::json(part))}});
  }
  return document_text(document);
}

Status draw_reproduction(const OutputFolder& folder) {
  const std::string file = folder.file(kReproductionFile).string();
  PALPATE_ASSIGN(const std::string text, read_file(file, kMemoryLimitBytes));
  try {
    const DocumentJson document = DocumentJson::parse(text);
    if (document.at("schema") != kSchema)
      return Error{"is not of the schema " + std::string(kSchema), "run reproduce again", file};
    std::vector<Part> parts;
    for (const DocumentJson& step : document.at("steps")) {
      PALPATE_ASSIGN(Part part, part_again(step, folder));
      parts.push_back(std::move(part));
    }
    return write_page(page_of(head_from(document), parts), folder);
  } catch (const nlohmann::json::exception& error) {
    return Error{fmt::format("is not what reproduce writes: {}", error.what()), "run reproduce again", file};
  }
}

void do_step(Reproduction& r, const Manifest& manifest, const std::function<void()>& work) {
  const std::string name = manifest.id(), key = RunKey().add(manifest.source).word();
  r.part = {};
  if (r.suite.take(name, key, r.part)) {
    r.steps.push_back({manifest, std::move(r.part)});
    return;
  }
  Case one;
  one.name = name;
  one.setting = manifest.table > 0 ? "table " + std::to_string(manifest.table) : name;
  if (!r.suite.measures(one)) return;
  r.folder.start_part();
  work();
  const bool came = !r.part.sections.empty();  // else the next run retries
  if (came)
    if (const Status kept = r.suite.keep(name, key, r.part); !kept) give_up(r, name, kept.error());
  r.steps.push_back({manifest, std::move(r.part)});
}

}  // namespace palpate::experiments
