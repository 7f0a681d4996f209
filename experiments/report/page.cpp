#include "experiments/report/page.h"

#include <fmt/format.h>

#include <algorithm>

#include "experiments/report/card.h"
#include "experiments/report/findings.h"
#include "experiments/report/model_picture.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {

std::string figure_html(const Figure& figure) {
  return fmt::format("<figure{}><h3>{}</h3>{}<figcaption>{}</figcaption></figure>\n",
                     figure.wide ? " class=\"wide\"" : "", html_escaped(figure.title),
                     figure.svg.empty() ? "" : "<div class=\"picture\">" + figure.svg + "</div>",
                     html_escaped(figure.caption));
}

namespace {

/// Terms and what is said of each.
std::string terms(const std::vector<std::pair<std::string, std::string>>& items, const char* kind) {
  std::string html = fmt::format("<dl class=\"{}\">\n", kind);
  for (const auto& [term, text] : items)
    html += fmt::format("<dt>{}</dt><dd>{}</dd>\n", html_escaped(term), html_escaped(text));
  return html + "</dl>\n";
}

std::string headlines_html(const Page& page) {
  std::string html;
  for (const HeadlineGroup& group : page.headlines) {
    if (group.lines.empty()) continue;
    if (!group.title.empty()) html += "<h2>" + html_escaped(group.title) + "</h2>\n";
    std::vector<std::pair<std::string, std::string>> items;
    for (const Headline& line : group.lines) items.emplace_back(line.lead, line.text);
    html += terms(items, "found");
  }
  return html.empty() ? "" : "<div class=\"headline\">\n" + html + "</div>\n";
}

/// Warnings of all studies first, then their notes.
std::string known_html(const Page& page) {
  std::string items;
  for (const bool warnings : {true, false})
    for (const Known& known : page.known)
      for (const std::string& text : warnings ? known.warnings : known.notes)
        items += fmt::format("<li{}>{}{}{}</li>\n", warnings ? " class=\"warning\"" : "",
                             warnings ? "<strong>Warning:</strong> " : "",
                             known.about.empty() ? "" : html_escaped(known.about) + ": ", html_escaped(text));
  return items.empty() ? ""
                       : "<div class=\"known\" id=\"known\">\n<h2>What to know</h2>\n<ul>\n" + items +
                             "</ul>\n</div>\n";
}

/// One line above everything, that leads to the warnings.
std::string warned_html(const Page& page) {
  std::size_t warnings = 0;
  for (const Known& known : page.known) warnings += known.warnings.size();
  if (warnings == 0) return {};
  return fmt::format(
      "<p class=\"warned\"><strong>{} warning{}:</strong> <a href=\"#known\">read {} before you trust these "
      "numbers</a></p>\n",
      warnings, warnings == 1 ? "" : "s", warnings == 1 ? "it" : "them");
}

std::string facts_html(const std::vector<Fact>& facts) {
  if (facts.empty()) return {};
  std::string html = "<h3>How it was run</h3>\n<dl class=\"facts\">\n";
  for (const Fact& fact : facts) {
    html += "<dt>" + html_escaped(fact.about) + "</dt><dd>";
    for (const std::string& sentence : fact.sentences) html += "<div>" + html_escaped(sentence) + "</div>";
    html += "</dd>\n";
  }
  return html + "</dl>\n";
}

/// `opened`: what it opens with stands at the top of the page already.
std::string section_html(const Section& section, bool opened) {
  std::string html =
      fmt::format("<section id=\"{}\">\n<h2>{}</h2>\n", section.id, html_escaped(section.title));
  if (!opened) html += section.opening;
  for (const std::string& paragraph : section.paragraphs) html += "<p>" + html_escaped(paragraph) + "</p>\n";
  for (const Table& table : section.tables) html += to_html(table);
  if (!section.figures.empty()) {
    html += "<div class=\"figures\">\n";
    for (const Figure& figure : section.figures) html += figure_html(figure);
    html += "</div>\n";
  }
  return html + facts_html(section.facts) + "</section>\n";
}

std::string about_html(const Page& page) {
  const metrics::DocumentHead& a = page.about;
  std::vector<std::pair<std::string, std::string>> items = {
      {"processor", fmt::format("{}, {} in use", a.machine.cpu, a.machine.cores)},
      {"memory", bytes_text(static_cast<double>(a.machine.memory_bytes))},
      {"system", a.machine.kernel},
      {"program", fmt::format("palpate {}, commit {}", a.version, a.commit)},
      {"build", a.build},
      {"started", a.started_utc}};
  for (auto& [term, text] : items)
    if (text.empty()) text = "unknown";
  std::string html = "<section id=\"about\">\n<h2>Machine, program, and how to repeat it</h2>\n";
  html += terms(items, "about") + "<pre>";
  for (const std::string& command : page.commands) html += html_escaped(command) + "\n";
  return html +
         "</pre>\n<p class=\"caption\">Every number of this page is in the JSON document beside it, every "
         "frame "
         "in the trace files; the scripts and data of the figures are in the folder figures. Times differ "
         "from "
         "run to run and from machine to machine; traces do not, and their hashes stand with each "
         "renderer.</p>\n</section>\n";
}

/// One paragraph a renderer: its options, the phases of its preparation, its hash, and what it noted.
Fact fact_of(const metrics::RendererResult& r) {
  std::string options, phases;
  for (const auto& [key, value] : r.options)
    options += fmt::format("{}{}={}", options.empty() ? "" : ", ", key, value);
  Fact fact{r.label, {r.name + (options.empty() ? "" : " with " + options)}};
  if (r.prepare) {
    for (const render::PreparePhase& phase : r.prepare->phases)
      phases += fmt::format("{}{} {}", phases.empty() ? "" : ", ", phase.name, duration_text(phase.ms));
    fact.sentences.push_back(fmt::format("prepared on {} thread{} in {}{}", r.threads,
                                         r.threads == 1 ? "" : "s", duration_text(r.prepare->total_ms),
                                         phases.empty() ? "" : ": " + phases));
    if (!r.prepare->notes.empty()) fact.sentences.push_back(joined(r.prepare->notes, "; "));
    for (const std::string& warning : r.prepare->warnings) fact.sentences.push_back("Warning: " + warning);
  }
  if (r.timing)
    fact.sentences.push_back(fmt::format(
        "timed {}{}{}", r.timing->own_process ? "in a process of its own" : "in the program's own process",
        r.timing->pinned_cpu ? fmt::format(", on processor {}", *r.timing->pinned_cpu)
                             : ", on no fixed processor",
        r.timing->in_turns_with > 0 ? fmt::format(", in turns with {} others", r.timing->in_turns_with)
                                    : ", alone"));
  if (!r.trace_hash.empty()) fact.sentences.push_back("trace hash " + r.trace_hash);
  return fact;
}

/// Under what conditions the times were measured.
std::optional<Fact> conditions_fact(const metrics::ResultDocument& document) {
  if (!document.conditions) return std::nullopt;
  const metrics::Conditions& c = *document.conditions;
  std::string libraries;
  for (const auto& [name, version] : c.libraries)
    libraries += fmt::format("{}{} {}", libraries.empty() ? "" : ", ", name, version);
  return Fact{"timing",
              {fmt::format("{} passes of each kind in random order (seed {}), at most {} s a renderer",
                           c.rounds, c.order_seed, short_number(c.budget_s)),
               fmt::format("stolen by the host {}; load {} before, {} after; governor {}; huge pages {}",
                           c.steal_percent ? short_number(*c.steal_percent) + " %" : "unknown",
                           short_number(c.load_before), short_number(c.load_after), c.governor, c.huge_pages),
               fmt::format("processor has {}; compiled for {} with {}", c.processor_sets, c.compiled_for,
                           c.compiler_flags),
               libraries}};
}

std::vector<Fact> facts_of(const Study& study) {
  std::vector<Fact> facts = {{"model", {study.document.scene}}, {"path", {study.document.path}}};
  if (std::optional<Fact> conditions = conditions_fact(study.document))
    facts.push_back(*std::move(conditions));
  if (study.reference)
    facts.push_back({"ground truth", {study.reference->name + ": " + study.reference->exactness}});
  for (const metrics::RendererResult& r : study.document.renderers) facts.push_back(fact_of(r));
  return facts;
}

/// How much of the path touches, in truth.
std::string contact_of_path(const Study& study) {
  if (!study.reference) return {};
  const auto& frames = study.reference->frames;
  const auto touching = static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const auto& f) { return f.frame.contact; }));
  return fmt::format("The path has {} frames: {} of true contact, {} in free space.",
                     count_text(frames.size()), count_text(touching), count_text(frames.size() - touching));
}

}  // namespace

Page begin_page(std::string title, const metrics::DocumentHead& about) {
  Page page;
  page.title = std::move(title);
  page.about = about;
  if (!about.command.empty()) page.commands.push_back(about.command);
  return page;
}

Known known_of(const std::string& about, const metrics::ResultDocument& document) {
  return {about, warnings_of(document), document.notes};
}

void add_known(Page& page, Known known) {
  if (!known.warnings.empty() || !known.notes.empty()) page.known.push_back(std::move(known));
}

void add_study(Page& page, const Study& study, const std::string& id, const std::string& name,
               const OutputFolder& folder) {
  Section section;
  section.id = id;
  section.title = study.document.title;
  if (!study.document.about.empty()) section.paragraphs.push_back(study.document.about);
  if (const std::string path = contact_of_path(study); !path.empty()) section.paragraphs.push_back(path);
  if (std::optional<Table> card = card_table(study.document)) section.tables.push_back(*std::move(card));
  Table table = comparison_table(study.document);
  if (study.reference) table.notes.insert(table.notes.end(), contact_words().begin(), contact_words().end());
  section.tables.push_back(std::move(table));
  Figure model = model_figure(study, id);
  if (const Result<OutputFolder> figures = folder.inside("figures")) {
    section.figures = draw_study(study, id, *figures);
    if (const Status written = figures->write(model.name + ".svg", model.svg); !written)
      model.caption += " It could not be written to the folder: " + written.error().message();
  } else {
    section.paragraphs.push_back("The figures could not be drawn: " + figures.error().message());
  }
  section.opening = opening_html(study.document) + figure_html(model);
  section.facts = facts_of(study);
  add_known(page, known_of(name, study.document));
  page.headlines.push_back({study.document.title, headlines_of(study.document)});
  page.sections.push_back(std::move(section));
}

Status draw_report(const OutputFolder& folder) {
  const Result<Study> study = read_study(folder.path());
  if (!study) return study.error();
  Page page = begin_page("Comparison of haptic renderers", study->document);
  add_study(page, *study, "study", {}, folder);
  return write_page(page, folder);
}

std::string to_html(const Page& page) {
  std::string html = fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\">\n"
      "<title>{0}</title>\n<style>{1}</style>\n</head>\n<body>\n<main>\n<h1>{0}</h1>\n<p "
      "class=\"by\">Palpate {2}, commit {3}, {4}; {5}</p>\n",
      html_escaped(page.title), page_style(), html_escaped(page.about.version),
      html_escaped(page.about.commit), html_escaped(page.about.started_utc),
      html_escaped(page.about.machine.cpu));
  const bool one = page.sections.size() == 1;
  html += warned_html(page) + (one ? page.sections.front().opening : "") + known_html(page) +
          headlines_html(page) + "<nav>";
  for (const Section& section : page.sections)
    html += fmt::format("<a href=\"#{}\">{}</a>", section.id, html_escaped(section.title));
  html += "<a href=\"#about\">Machine and commands</a></nav>\n";
  for (const Section& section : page.sections) html += section_html(section, one);
  return html + about_html(page) + "</main>\n</body>\n</html>\n";
}

Status write_page(const Page& page, const OutputFolder& folder) {
  return folder.write(kReportFile, to_html(page));
}

}  // namespace palpate::experiments
