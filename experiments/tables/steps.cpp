// The steps of `palpate reproduce`: each is kept as soon as it is complete, with all that it has put on the
// page.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/tables/reproduction.h"

namespace palpate::experiments {
namespace {

/// What one step has added.
struct Yield {
  std::vector<Known> known;
  std::vector<HeadlineGroup> headlines;
  std::vector<Section> sections;
  std::vector<Table> tables;
  std::vector<std::string> missing, stand_ins;
  bool fell_short = false;
};

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

namespace {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Yield, known, headlines, sections, tables, missing, stand_ins, fell_short)

/// The lists that a step adds to, and how long they were before.
template <class T>
std::vector<T> added(const std::vector<T>& all, std::size_t before) {
  return {all.begin() + static_cast<std::ptrdiff_t>(before), all.end()};
}
template <class T>
void add(std::vector<T>& all, std::vector<T>&& more) {
  std::move(more.begin(), more.end(), std::back_inserter(all));
}

bool add_kept(const std::string& text, Reproduction& r) {
  try {
    Yield step = nlohmann::json::parse(text).get<Yield>();
    add(r.page.known, std::move(step.known));
    add(r.page.headlines, std::move(step.headlines));
    add(r.page.sections, std::move(step.sections));
    add(r.tables, std::move(step.tables));
    add(r.missing, std::move(step.missing));
    add(r.stand_ins, std::move(step.stand_ins));
    r.fell_short = r.fell_short || step.fell_short;
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

}  // namespace

void do_step(Reproduction& r, const std::string& name, const std::string& key,
             const std::function<void()>& work) {
  if (r.folder.take_over(name, key, [&](const std::string& text) { return add_kept(text, r); })) return;
  const std::size_t known = r.page.known.size(), headlines = r.page.headlines.size(),
                    sections = r.page.sections.size(), tables = r.tables.size(), missing = r.missing.size(),
                    stand_ins = r.stand_ins.size();
  const bool fell_short = std::exchange(r.fell_short, false);
  r.folder.start_part();
  work();
  const Yield step = {added(r.page.known, known),
                      added(r.page.headlines, headlines),
                      added(r.page.sections, sections),
                      added(r.tables, tables),
                      added(r.missing, missing),
                      added(r.stand_ins, stand_ins),
                      r.fell_short};
  r.fell_short = r.fell_short || fell_short;
  if (step.sections.empty()) return;  // nothing came of it: the next run tries again
  const std::string text =
      nlohmann::json(step).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (const Status kept = r.folder.keep(name, key, text); !kept) give_up(r, name, kept.error());
}

}  // namespace palpate::experiments
