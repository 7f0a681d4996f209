#include "experiments/driver/page_document.h"

#include <fmt/format.h>

#include <utility>

#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/metrics/result_keys.h"

namespace palpate::experiments {
namespace {

constexpr const char* kPageSchema = "palpate-page/1";
constexpr const char* kFigures = "figures";

/// Fails to compile when a member is added: describe it in the header, then count it here.
[[maybe_unused]] void name_all_members(Cell& c, Table& t, Figure& f, Fact& a, Headline& h, HeadlineGroup& g,
                                       Known& k, Section& s, Page& p) {
  [[maybe_unused]] const auto& [c1, c2, c3, c4] = c;
  [[maybe_unused]] const auto& [t1, t2, t3, t4, t5, t6, t7, t8] = t;
  [[maybe_unused]] const auto& [f1, f2, f3, f4, f5] = f;
  [[maybe_unused]] const auto& [a1, a2] = a;
  [[maybe_unused]] const auto& [h1, h2] = h;
  [[maybe_unused]] const auto& [g1, g2] = g;
  [[maybe_unused]] const auto& [k1, k2, k3] = k;
  [[maybe_unused]] const auto& [s1, s2, s3, s4, s5, s6, s7, s8] = s;
  [[maybe_unused]] const auto& [p1, p2, p3, p4, p5, p6, p7, p8, p9, p10] = p;
}

}  // namespace

metrics::DocumentHead head_from(const nlohmann::json& document) {
  metrics::DocumentHead head;
  document.at("version").get_to(head.version);
  document.at("commit").get_to(head.commit);
  document.at("build").get_to(head.build);
  const nlohmann::json& machine = document.at("machine");
  metrics::visit_machine([&](const char* key, auto& value) { machine.at(key).get_to(value); }, head.machine);
  document.at("started_utc").get_to(head.started_utc);
  document.at("command").get_to(head.command);
  return head;
}

void put_scripts(std::vector<Section>& sections) {
  for (Section& section : sections)
    for (Figure& figure : section.figures)
      if (!figure.svg.empty()) figure.svg = fmt::format("{}/{}.gp", kFigures, figure.name);
}

Status draw_scripts(std::vector<Section>& sections, const OutputFolder& folder) {
  for (Section& section : sections)
    for (Figure& figure : section.figures) {
      if (figure.svg.empty()) continue;
      PALPATE_ASSIGN(const OutputFolder figures, folder.inside(kFigures));
      figure = drawn_again(std::move(figure), figures);
    }
  return Done{};
}

Status keep_page(const Page& page, const OutputFolder& folder) {
  Page kept = page;
  put_scripts(kept.sections);
  DocumentJson document = begin_json(kPageSchema, page.about);
  document.update(DocumentJson(nlohmann::json(kept)));
  PALPATE_TRY(folder.write(kPageFile, document_text(document)));
  return write_page(page, folder);
}

Status draw_again(const OutputFolder& folder, const char* name, const char* schema,
                  const std::function<Result<Page>(const nlohmann::json&)>& page) {
  const std::string file = folder.file(name).string();
  const auto wrong = [&](const std::string& what) {
    return Error{what, "run the command that wrote this folder again", file};
  };
  PALPATE_ASSIGN(const std::string text, read_file(file, kMemoryLimitBytes));
  try {
    const nlohmann::json document = nlohmann::json::parse(text);
    if (document.at("schema") != schema) return wrong(fmt::format("is not of schema {}", schema));
    PALPATE_ASSIGN(const Page drawn, page(document));
    return write_page(drawn, folder);
  } catch (const nlohmann::json::exception& error) {
    return wrong(fmt::format("cannot be drawn again: {}", error.what()));
  }
}

Status draw_kept_page(const OutputFolder& folder) {
  return draw_again(folder, kPageFile, kPageSchema, [&](const nlohmann::json& document) -> Result<Page> {
    Page page = document.get<Page>();
    page.about = head_from(document);
    PALPATE_TRY(draw_scripts(page.sections, folder));
    return page;
  });
}

}  // namespace palpate::experiments
