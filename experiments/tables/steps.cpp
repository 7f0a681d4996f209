// Steps of `palpate reproduce`. Each is stored when complete, with its part of the report, and the report is
// drawn again from storage.
#include <palpate/result.h>
#include "experiments/driver/page_document.h"
#include "experiments/tables/reproduction.h"

namespace palpate::experiments {
namespace {

/// Fails to compile when a member is added: describe it below, then count it here.
[[maybe_unused]] void name_all_members(Answer& w, Part& p) {
  [[maybe_unused]] const auto& [w1, w2, w3, w4, w5, w6, w7, w8, w9, w10, w11, w12, w13, w14, w15] = w;
  [[maybe_unused]] const auto& [p1, p2, p3, p4, p5] = p;
}

}  // namespace

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Answer, table, page, says, printed, literal, ours, ratio, error,
                                   mesh_error, status, reproduced, as_fast, literal_right, ours_right, take)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Part, known, sections, answers, missing, fell_short)

namespace {

constexpr const char* kSchema = "palpate-reproduction/1";

/// True if the step's part is drawn from its study.
bool has_study(const Step& step) {
  return step.manifest.kind == Manifest::Kind::kFrames && !step.part.sections.empty();
}

/// A step's part again: from its study, or from storage and the figures' scripts.
Result<Part> part_again(const nlohmann::json& step, const OutputFolder& folder) {
  Part part = step.at("page").get<Part>();
  if (!step.at("study").get<bool>()) {
    PALPATE_TRY(draw_scripts(part.sections, folder));
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
    put_scripts(part.sections);
    document["steps"].push_back({{"id", step.manifest.id()},
                                 {"manifest", step.manifest.source},
                                 {"study", has_study(step)},
                                 {"page", DocumentJson(nlohmann::json(part))}});
  }
  return document_text(document);
}

Status draw_reproduction(const OutputFolder& folder) {
  return draw_again(folder, kReproductionFile, kSchema, [&](const nlohmann::json& document) -> Result<Page> {
    std::vector<Part> parts;
    for (const nlohmann::json& step : document.at("steps")) {
      PALPATE_ASSIGN(Part part, part_again(step, folder));
      parts.push_back(std::move(part));
    }
    return page_of(head_from(document), parts);
  });
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
