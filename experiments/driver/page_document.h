// A page as a document: all that its HTML is drawn from, kept beside it in page.json. A drawn figure of a
// section stands in it as the script that draws it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "experiments/driver/json_document.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

// With defaults: documents of earlier versions lack what came later.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Cell, text, best, bad, link)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Table, title, caption, columns, rows, notes, turns, best_means, bad_means)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figure, name, title, caption, svg, wide)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Fact, about, sentences)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Headline, lead, text)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(HeadlineGroup, title, lines)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Known, about, warnings, notes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Section, id, title, opening, paragraphs, tables, figures,
                                                facts, found)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Page, title, answers, tables, headlines, figures, known,
                                                sections, apart, commands)

inline constexpr const char* kPageFile = "page.json";

/// Head of a document that begin_json() began. Throws nlohmann::json::exception where a key is wrong.
[[nodiscard]] metrics::DocumentHead head_from(const nlohmann::json& document);

/// Puts the script's name in the place of each picture in the sections, and draws them all again by it from
/// the scripts in `folder`/figures.
void put_scripts(std::vector<Section>& sections);
[[nodiscard]] Status draw_scripts(std::vector<Section>& sections, const OutputFolder& folder);

/// Writes the page that `page` makes of a document of this schema in the folder. Error: names the file.
[[nodiscard]] Status draw_again(const OutputFolder& folder, const char* name, const char* schema,
                                const std::function<Result<Page>(const nlohmann::json&)>& page);

/// Writes page.json and the page.
[[nodiscard]] Status keep_page(const Page& page, const OutputFolder& folder);
/// Draws the page again from page.json and the figures' scripts. Error: names the file.
[[nodiscard]] Status draw_kept_page(const OutputFolder& folder);

}  // namespace palpate::experiments
