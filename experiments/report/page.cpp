#include "experiments/report/page.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/report/figures.h"
#include "experiments/report/findings.h"
#include "experiments/report/fronts.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

namespace {

/// A figure as it stands on a page: picture, title and caption.
std::string figure_html(const Figure& figure) {
  return fmt::format("<figure{}><h3>{}</h3>{}<figcaption>{}</figcaption></figure>\n",
                     figure.wide ? " class=\"wide\"" : "", html_escaped(figure.title),
                     figure.svg.empty() ? "" : "<div class=\"picture\">" + figure.svg + "</div>",
                     html_escaped(figure.caption));
}

/// Terms and what is said of each.
std::string terms(const std::vector<std::pair<std::string, std::string>>& items, const char* kind) {
  std::string html = fmt::format("<dl class=\"{}\">\n", kind);
  for (const auto& [term, text] : items)
    html += fmt::format("<dt>{}</dt><dd>{}</dd>\n", html_escaped(term), html_escaped(text));
  return html + "</dl>\n";
}

std::string found_html(const std::vector<Headline>& lines) {
  std::vector<std::pair<std::string, std::string>> items;
  for (const Headline& line : lines) items.emplace_back(line.lead, line.text);
  return items.empty() ? "" : terms(items, "found");
}

std::string headlines_html(const Page& page) {
  std::string html;
  for (const HeadlineGroup& group : page.headlines)
    if (!group.lines.empty())
      html += (group.title.empty() ? "" : "<h2>" + html_escaped(group.title) + "</h2>\n") +
              found_html(group.lines);
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

std::string figures_html(const std::vector<Figure>& figures) {
  std::string html;
  for (const Figure& figure : figures) html += figure_html(figure);
  return html.empty() ? "" : "<div class=\"figures\">\n" + html + "</div>\n";
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

/// `heading`: empty where the title stands above already.
std::string section_html(const Section& section, const std::string& heading) {
  std::string html = fmt::format("<section id=\"{}\">\n{}{}{}", section.id,
                                 heading.empty() ? "" : "<h2>" + html_escaped(heading) + "</h2>\n",
                                 section.opening, found_html(section.found));
  for (const std::string& paragraph : section.paragraphs) html += "<p>" + html_escaped(paragraph) + "</p>\n";
  for (const Table& table : section.tables) html += to_html(table);
  return html + figures_html(section.figures) + facts_html(section.facts) + "</section>\n";
}

std::string page_file(const Section& section) {
  return section.id + ".html";
}

/// A whole page around its body.
std::string whole_html(const Page& page, const std::string& title, const std::string& body) {
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\">\n"
      "<title>{0}</title>\n<style>{1}</style>\n</head>\n<body>\n<main>\n<h1>{0}</h1>\n{6}<p "
      "class=\"by\">Palpate {2}, commit {3}, {4}; {5}</p>\n</main>\n</body>\n</html>\n",
      html_escaped(title), page_style(), html_escaped(page.about.version), html_escaped(page.about.commit),
      html_escaped(page.about.started_utc), html_escaped(page.about.machine.cpu), body);
}

std::string about_html(const Page& page) {
  const metrics::DocumentHead& a = page.about;
  std::vector<std::pair<std::string, std::string>> items = {
      {"processor", fmt::format("{}, {} in use", a.machine.cpu, a.machine.cores)},
      {"memory", format_bytes(static_cast<double>(a.machine.memory_bytes))},
      {"system", a.machine.kernel},
      {"program", fmt::format("palpate {}, commit {}", a.version, a.commit)},
      {"build", a.build},
      {"started", a.started_utc}};
  for (auto& [term, text] : items)
    if (text.empty()) text = "unknown";
  return "<section id=\"about\">\n<h2>Machine, program, and how to repeat it</h2>\n" + terms(items, "about") +
         "<pre>" + html_escaped(joined(page.commands, "\n")) +
         "\n</pre>\n<p class=\"caption\">Every number of this page is in the JSON document beside it, every "
         "frame in the trace files; the scripts and data of the figures are in the folder figures. Times "
         "differ from run to run and from machine to machine; traces do not, and their hashes stand with "
         "each renderer.</p>\n</section>\n";
}

/// One paragraph a renderer: its options, the phases of its preparation, its hash, and what it noted.
Fact fact_of(const metrics::RendererResult& r) {
  std::vector<std::string> options, phases;
  for (const auto& [key, value] : r.options) options.push_back(fmt::format("{}={}", key, value));
  Fact fact{r.label, {r.name + (options.empty() ? "" : " with " + joined(options))}};
  if (r.prepare) {
    for (const render::PreparePhase& phase : r.prepare->phases)
      phases.push_back(phase.name + " " + format_duration(phase.ms));
    fact.sentences.push_back(fmt::format("prepared on {} thread{} in {}{}", r.threads,
                                         r.threads == 1 ? "" : "s", format_duration(r.prepare->total_ms),
                                         phases.empty() ? "" : ": " + joined(phases)));
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
  const metrics::MeasurementConditions& c = *document.conditions;
  std::vector<std::string> libraries;
  for (const auto& [name, version] : c.libraries) libraries.push_back(name + " " + version);
  return Fact{
      "timing",
      {fmt::format("{} passes of each kind in random order (seed {}), at most {} s a renderer", c.rounds,
                   c.order_seed, format_number(c.budget_s)),
       fmt::format("stolen by the host {}; load {} before, {} after; governor {}; huge pages {}",
                   c.steal_percent ? format_number(*c.steal_percent) + " %" : "unknown",
                   format_number(c.load_before), format_number(c.load_after), c.governor, c.huge_pages),
       fmt::format("processor has {}; compiled for {} with {}", c.processor_sets, c.compiled_for,
                   c.compiler_flags),
       joined(libraries)}};
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

/// Share of the path that touches, in truth.
std::string contact_of_path(const Study& study) {
  if (!study.reference) return {};
  const auto& frames = study.reference->frames;
  const auto touching = static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const auto& f) { return f.frame.contact; }));
  return fmt::format("The path has {} frames: {} of true contact, {} in free space.",
                     format_count(frames.size()), format_count(touching),
                     format_count(frames.size() - touching));
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
    if (const Status written = figures->write(model.name + ".svg", model.svg); !written)
      model.caption += " It could not be written to the folder: " + written.error().message();
    section.figures = {draw(trade_chart(id + kTradeSuffix, study.document), *figures), std::move(model)};
    for (Figure& figure : draw_study(study, id, *figures)) section.figures.push_back(std::move(figure));
  } else {
    section.paragraphs.push_back("The figures could not be drawn: " + figures.error().message());
  }
  section.found = headlines_of(study.document);
  section.facts = facts_of(study);
  add_known(page, known_of(name, study.document));
  page.sections.push_back(std::move(section));
}

Status draw_report(const OutputFolder& folder) {
  const Result<Study> study = read_study(folder.path());
  if (!study) return study.error();
  Page page = begin_page("Comparison of haptic renderers", study->document);
  page.apart = true;
  if (const Headline answer = answer_of(study->document); !answer.text.empty()) page.answers = {answer};
  page.tables = {summary_table(study->document)};
  add_study(page, *study, "study", {}, folder);
  Section& section = page.sections.back();
  section.title += ": scores, pictures, how it was run";
  if (!section.figures.empty()) {
    page.figures = {std::move(section.figures.front())};
    section.figures.erase(section.figures.begin());
  }
  return write_page(page, folder);
}

std::string to_html(const Page& page) {
  std::string body =
      page.answers.empty() ? "" : "<div class=\"answer\">" + found_html(page.answers) + "</div>\n";
  for (const Table& table : page.tables) body += "<div class=\"first\">" + to_html(table) + "</div>\n";
  std::string more, sections;
  for (const Section& section : page.sections) {
    more += fmt::format("<a href=\"{}\">{}</a>", page.apart ? page_file(section) : "#" + section.id,
                        html_escaped(section.title));
    if (!page.apart) sections += section_html(section, section.title);
  }
  body += figures_html(page.figures) + headlines_html(page) + "<nav>" + more +
          "<a href=\"#about\">Machine and commands</a></nav>\n" + known_html(page) + sections;
  return whole_html(page, page.title, body + about_html(page));
}

std::string section_page(const Page& page, const Section& section) {
  return whole_html(page, section.title,
                    fmt::format("<nav><a href=\"{}\">{}</a></nav>\n{}", kReportFile, html_escaped(page.title),
                                section_html(section, {})));
}

Status write_page(const Page& page, const OutputFolder& folder) {
  for (const Section& section : page.sections)
    if (page.apart) PALPATE_TRY(folder.write(page_file(section), section_page(page, section)));
  return folder.write(kReportFile, to_html(page));
}

const char* page_style() {
  return R"css(
:root { color-scheme: light dark; --ink:#1c2126; --soft:#59636e; --paper:#fbfbf9; --card:#ffffff; --line:#dfe2e6; --accent:#0072b2; --best:#00694f; --bad:#b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink:#e7e9ec; --soft:#a3adb8; --paper:#15181b; --card:#1d2226; --line:#363d44; --accent:#6cb8ea; --best:#5fd0aa; --bad:#ff8a80; } }
* { box-sizing: border-box; }
body { margin:0; background:var(--paper); color:var(--ink); font:16px/1.55 system-ui,-apple-system,"Segoe UI","Liberation Sans",Helvetica,Arial,sans-serif; }
main { max-width:72rem; margin:0 auto; padding:1.5rem clamp(.9rem,3vw,2.5rem) 4rem; }
h1 { font-size:clamp(1.5rem,4vw,2.2rem); line-height:1.2; margin:.6rem 0 .2rem; }
h2 { font-size:1.4rem; margin:2.8rem 0 .5rem; padding-top:1rem; border-top:2px solid var(--line); }
p { margin:.5rem 0; max-width:48rem; overflow-wrap:anywhere; }
.by { max-width:none; color:var(--soft); font-size:.92rem; }
.headline { background:var(--card); border:1px solid var(--line); border-left:5px solid var(--accent); border-radius:6px; padding:.4rem 1.2rem .9rem; margin:1.2rem 0; }
.answer { border-left:5px solid var(--best); background:var(--card); padding:.3rem 1.2rem; margin:.8rem 0; } .answer dl.found { font-size:1.06rem; } .answer dt { color:var(--ink); font-weight:600; }
.first :is(th,td) { white-space:normal; min-width:0; } .first th:first-child { min-width:3.5rem; }
.headline h2 { font-size:1.02rem; margin:1rem 0 .25rem; padding:0; border:0; }
.known { border:1px solid var(--line); border-left:5px solid var(--bad); border-radius:6px; background:var(--card); padding:.4rem 1.2rem .7rem; margin:1.2rem 0; font-size:.95rem; }
.known h2 { font-size:1.02rem; margin:.5rem 0 .25rem; padding:0; border:0; } .known ul { margin:.2rem 0; padding-left:1.1rem; } .known li { overflow-wrap:anywhere; } .known .warning strong { color:var(--bad); }
.verdict { max-width:none; margin:.5rem 0; padding:.5rem .9rem; border-left:5px solid var(--bad); background:var(--card); } .verdict.reached { border-color:var(--best); } .verdict.reached strong { color:var(--best); } .verdict.part { border-color:#c77700; } .verdict.missed strong { color:var(--bad); }
td a, th a { color:var(--accent); } nav { font-size:.95rem; margin:.8rem 0; } nav a { color:var(--accent); margin-right:1.1rem; display:inline-block; }
.scroll { overflow-x:auto; margin:1.1rem 0 .3rem; border:1px solid var(--line); border-radius:6px; background:var(--card); }
table { border-collapse:collapse; width:100%; font-size:.93rem; font-variant-numeric:tabular-nums; }
caption { text-align:left; padding:.6rem .8rem; font-weight:600; overflow-wrap:anywhere; }
th, td { padding:.34rem .8rem; text-align:right; white-space:nowrap; border-top:1px solid var(--line); }
thead th { font-weight:600; border-bottom:2px solid var(--line); white-space:normal; vertical-align:bottom; min-width:5.5rem; }
th:first-child { text-align:left; font-weight:400; min-width:8rem; white-space:normal; position:sticky; left:0; background:var(--card); }
tr.group th { font-weight:600; color:var(--soft); padding-top:.9rem; font-size:.85rem; letter-spacing:.02em; }
td.best { font-weight:700; color:var(--best); } td.bad { font-weight:700; color:var(--bad); } td.best, td.bad { position:relative; } .mark { position:absolute; padding-left:.08em; }
:is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) { font-size:.82rem; } :is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) :is(th,td) { padding:.3rem .5rem .3rem .4rem; min-width:0; }
.turned th:first-child { white-space:nowrap; } .n8 td { white-space:normal; } td.words { text-align:left; white-space:normal; } thead th.words { text-align:left; }
:is(th,td):last-child { padding-right:1rem; } .legend { margin:.2rem 0; } .legend span { margin-right:1.4rem; white-space:nowrap; }
.caption, .legend, .notes, .facts { color:var(--soft); font-size:.88rem; } .notes { padding-left:1.2rem; max-width:60rem; }
h3 { font-size:1rem; margin:1.4rem 0 .3rem; }
.figures { display:grid; grid-template-columns:repeat(2,minmax(0,1fr)); gap:1.1rem; margin:1.2rem 0; }
figure { margin:0; background:var(--card); border:1px solid var(--line); border-radius:6px; padding:.7rem .8rem; min-width:0; }
figure.wide { grid-column:1/-1; }
figure h3 { margin:.1rem .2rem .4rem; font-size:1rem; }
figure .picture { background:#fff; border-radius:4px; overflow-x:auto; } figure svg { display:block; width:100%; height:auto; }
figcaption { color:var(--soft); font-size:.87rem; margin:.45rem .2rem 0; }
pre { background:var(--card); border:1px solid var(--line); border-radius:6px; padding:.7rem .9rem; overflow-x:auto; font-size:.86rem; white-space:pre-wrap; overflow-wrap:anywhere; }
dl { display:grid; grid-template-columns:minmax(7.5rem,max-content) 1fr; gap:.2rem 1.2rem; margin:.3rem 0; font-size:.93rem; } dt { color:var(--soft); } dd { margin:0; overflow-wrap:anywhere; max-width:54rem; }
dl.found { grid-template-columns:11.5rem 1fr; font-size:.97rem; } dl.found dd { max-width:none; } dl.facts { gap:.45rem 1.2rem; font-size:.86rem; } dl.facts dt { color:var(--ink); font-weight:600; }
@media (max-width:46rem) { .figures { grid-template-columns:minmax(0,1fr); } figure.wide .picture svg { min-width:34rem; } th,td { padding:.3rem .55rem; } dl, dl.found, dl.facts { grid-template-columns:minmax(0,1fr); gap:0; } dd { margin-bottom:.5rem; } dl.found dt { font-weight:600; } }
@media print {
  :root { --ink:#000; --soft:#444; --paper:#fff; --card:#fff; --line:#bbb; --accent:#0072b2; --best:#00694f; --bad:#b3261e; }
  @page { size:A4; margin:14mm; }
  body { font-size:10pt; } main { max-width:none; padding:0; } nav { display:none; }
  table { font-size:8.4pt; } :is(.n8,.n9,.n10) { font-size:7.6pt; } :is(.n11,.n12,.n13) { font-size:6.6pt; } :is(.n14,.n15,.n16) { font-size:5.8pt; }
  table :is(th,td), :is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) :is(th,td) { padding:.14rem .38rem; min-width:0; } th:first-child { position:static; } :is(th,td):last-child { padding-right:.6rem; } .legend span { white-space:normal; } .scroll { border:0; border-radius:0; margin:.6rem 0 .2rem; }
  .turned { break-inside:avoid; } tbody tr:first-child, tr.group + tr { break-before:avoid; }
  h2 { break-after:avoid; } figure, .headline dl, tr, dd, pre { break-inside:avoid; } h3, dt, caption { break-after:avoid; } .scroll, figure .picture { overflow:visible; } thead { display:table-header-group; }
}
)css";
}

}  // namespace palpate::experiments
