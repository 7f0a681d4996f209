#include "experiments/report/page.h"

#include <fmt/format.h>

namespace palpate::experiments {
namespace {

std::string list(const std::vector<std::string>& items, const char* open) {
  if (items.empty()) return {};
  std::string html = open;
  for (const std::string& item : items) html += "<li>" + html_escaped(item) + "</li>\n";
  return html + "</ul>\n";
}

std::string figure_html(const Figure& figure) {
  return fmt::format("<figure{}><h3>{}</h3>{}<figcaption>{}</figcaption></figure>\n",
                     figure.wide ? " class=\"wide\"" : "", html_escaped(figure.title),
                     figure.svg.empty() ? "" : "<div class=\"picture\">" + figure.svg + "</div>",
                     html_escaped(figure.caption));
}

std::string section_html(const Section& section) {
  std::string html =
      fmt::format("<section id=\"{}\">\n<h2>{}</h2>\n", section.id, html_escaped(section.title));
  for (const std::string& paragraph : section.paragraphs) html += "<p>" + html_escaped(paragraph) + "</p>\n";
  for (const Table& table : section.tables) html += to_html(table);
  if (!section.figures.empty()) {
    html += "<div class=\"figures\">\n";
    for (const Figure& figure : section.figures) html += figure_html(figure);
    html += "</div>\n";
  }
  return html + list(section.facts, "<ul class=\"facts\">\n") + "</section>\n";
}

std::string about_html(const Page& page) {
  constexpr double kBytesPerGb = 1e9;
  const metrics::ResultDocument& a = page.about;
  const auto item = [](const char* key, const std::string& value) {
    return fmt::format("<dt>{}</dt><dd>{}</dd>\n", key, html_escaped(value.empty() ? "unknown" : value));
  };
  std::string html = "<section id=\"about\">\n<h2>Machine, program, and how to repeat it</h2>\n<dl>\n";
  html += item("processor", fmt::format("{}, {} in use", a.machine.cpu, a.machine.cores));
  html += item("memory", fmt::format("{:.1f} GB", static_cast<double>(a.machine.memory_bytes) / kBytesPerGb));
  html += item("system", a.machine.kernel);
  html += item("program", fmt::format("palpate {}, commit {}", a.version, a.commit));
  html += item("build", a.build);
  html += item("started", a.started_utc);
  html += "</dl>\n<pre>";
  for (const std::string& command : page.commands) html += html_escaped(command) + "\n";
  return html +
         "</pre>\n<p class=\"caption\">Every number of this page is in result.json, every frame in the trace "
         "files beside it; the figures' scripts "
         "and data are in the folder figures. Times differ from run to run and from machine to machine, "
         "traces do not: "
         "their hashes are named with each renderer's options.</p>\n</section>\n";
}

std::vector<std::string> facts_of(const Study& study) {
  std::vector<std::string> facts;
  for (const std::string& note : study.stage.notes) facts.push_back(note);
  if (study.stage.reference)
    facts.push_back(
        fmt::format("Ground truth: {}. {}", study.stage.reference->name, study.stage.reference->exactness));
  for (const metrics::RendererResult& r : study.document.renderers) {
    std::string options;
    for (const auto& [key, value] : r.options)
      options += fmt::format("{}{}={}", options.empty() ? "" : ", ", key, value);
    std::string phases;
    if (r.prepare)
      for (const render::PreparePhase& phase : r.prepare->phases)
        phases += fmt::format("{}{} {}", phases.empty() ? "; prepared in: " : ", ", phase.name,
                              duration_text(phase.ms));
    facts.push_back(fmt::format("{} is {}{}{}{}; threads of preparation {}; trace hash {}", r.label, r.name,
                                options.empty() ? "" : " with ", options, phases, r.threads,
                                r.trace_hash.empty() ? "none" : r.trace_hash));
    if (r.prepare)
      for (const std::string& note : r.prepare->notes) facts.push_back(r.label + ": " + note);
  }
  return facts;
}

}  // namespace

Page begin_page(std::string title, const metrics::ResultDocument& about) {
  Page page;
  page.title = std::move(title);
  page.about = about;
  if (!about.command.empty()) page.commands.push_back(about.command);
  return page;
}

void add_study(Page& page, const Study& study, const std::string& id, const OutputFolder& folder) {
  Section section;
  section.id = id;
  section.title = study.title;
  if (!study.text.empty()) section.paragraphs.push_back(study.text);
  section.tables.push_back(comparison_table(study.document));
  section.tables.back().caption =
      "Green and bold: the best of the row. Frame times are of contact frames; the mean is without the "
      "clock's own cost.";
  if (const Result<OutputFolder> figures = folder.inside("figures"))
    section.figures = draw_study(study, id, *figures);
  else
    section.paragraphs.push_back("The figures could not be drawn: " + figures.error().message());
  section.facts = facts_of(study);
  for (std::string& headline : headlines_of(study.document, study.name))
    page.headlines.push_back(std::move(headline));
  page.sections.push_back(std::move(section));
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
  html += "<div class=\"headline\">" + list(page.headlines, "<ul>\n") + "</div>\n<nav>";
  for (const Section& section : page.sections)
    html += fmt::format("<a href=\"#{}\">{}</a>", section.id, html_escaped(section.title));
  html += "<a href=\"#about\">Machine and commands</a></nav>\n";
  for (const Section& section : page.sections) html += section_html(section);
  return html + about_html(page) + "</main>\n</body>\n</html>\n";
}

Status write_page(const Page& page, const OutputFolder& folder) {
  return folder.write("report.html", to_html(page));
}

}  // namespace palpate::experiments
