// fringecal man, fringecal completion: manual page and shell completion, both read off the commands themselves, so that
// they say what --help says.
#include "cli/commands.h"
#include "core/error.h"
#include "core/provenance.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  std::vector<const CLI::App*> out;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (!command->get_name().empty()) out.push_back(command);
  }
  return out;
}

std::vector<const CLI::Option*> options_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option*) { return true; });
}

/// "--output", "-o".
std::vector<std::string> spellings(const CLI::Option& option) {
  std::vector<std::string> out;
  for (const auto& name : option.get_lnames()) out.push_back("--" + name);
  for (const auto& name : option.get_snames()) out.push_back("-" + name);
  return out;
}

// ---- manual page, troff -man ----

std::string troff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n'))
      out += std::string("\\&") + c;
    else
      out += c;
  }
  return out;
}

std::string option_page(const CLI::Option& option) {
  std::string names;
  for (const auto& name : spellings(option)) names += (names.empty() ? "" : ", ") + name;
  if (names.empty()) names = option.get_name(true);
  return fmt::format(".TP\n.B {}\n{}{}\n", troff(names), troff(option.get_description()),
                     option.get_required() ? " (required)" : "");
}

std::string command_page(const CLI::App& command, const std::string& path) {
  const std::string name = path + " " + command.get_name();
  std::string out = fmt::format(".SS \"{}\"\n{}.\n", troff(name), troff(command.get_description()));
  for (const CLI::Option* option : options_of(command)) {
    if (option->get_name() != "--help,-h" && option->get_name() != "-h,--help") out += option_page(*option);
  }
  if (!command.get_footer().empty()) out += ".PP\n" + troff(command.get_footer()) + "\n";
  for (const CLI::App* below : commands_of(command)) out += command_page(*below, name);
  return out;
}

std::string manual_page(const CLI::App& program) {
  const std::string& name = program.get_name();
  std::string out = fmt::format(
      ".TH FRINGECAL 1 \"\" \"fringecal {}\" \"User Commands\"\n.SH NAME\n{}\n.SH SYNOPSIS\n.B {}\ncommand [options]\n"
      ".SH COMMANDS\n",
      kProgramVersion, troff(program.get_description()), troff(name));
  for (const CLI::App* command : commands_of(program)) out += command_page(*command, name);
  out +=
      ".SH EXIT STATUS\n.TP\n0\ndone\n.TP\n1\na defect of the program itself\n.TP\n2\nthe input cannot be used; the "
      "sentence on the error output says what to do\n.TP\n3\nthe machine or a device failed\n.TP\n130\nstopped by "
      "Ctrl\\-C, safely; the same command continues\n";
  return out;
}

// ---- completion ----

/// Every command and its words, "certify" or "history list"; the program itself as "".
struct Words {
  std::string path;
  std::vector<const CLI::App*> commands;
  std::vector<const CLI::Option*> options;
};

void collect(const CLI::App& app, const std::string& path, std::vector<Words>& out) {
  out.push_back({path, commands_of(app), options_of(app)});
  for (const CLI::App* below : commands_of(app)) {
    collect(*below, path.empty() ? below->get_name() : path + " " + below->get_name(), out);
  }
}

std::string bash_completion(const std::vector<Words>& all) {
  std::string cases;
  for (const Words& words : all) {
    std::string list;
    for (const CLI::App* command : words.commands) list += command->get_name() + " ";
    for (const CLI::Option* option : words.options) {
      for (const auto& name : spellings(*option)) list += name + " ";
    }
    cases += fmt::format("    \"{}\") words=\"{}\" ;;\n", words.path, list);
  }
  std::string paths;
  for (const Words& words : all) {
    if (!words.path.empty()) paths += fmt::format("      \"{}\") path=\"{}\" ;;\n", words.path, words.path);
  }
  return fmt::format(
      "# bash completion of fringecal\n"
      "_fringecal() {{\n"
      "  local current=${{COMP_WORDS[COMP_CWORD]}} path=\"\" words=\"\" word\n"
      "  for word in \"${{COMP_WORDS[@]:1:COMP_CWORD-1}}\"; do\n"
      "    case \"${{path:+$path }}$word\" in\n{}    esac\n  done\n"
      "  case \"$path\" in\n{}  esac\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
      "}}\n"
      "complete -o default -F _fringecal fringecal\n",
      paths, cases);
}

/// For a zsh array in single quotes, "name:description".
std::string zsh_entry(const std::string& name, const std::string& description) {
  std::string out;
  for (const char c : fmt::format("{}\x01{}", name, description)) {
    if (c == '\'')
      out += "'\\''";
    else if (c == ':')
      out += "\\:";
    else
      out += c == '\x01' ? ':' : c;
  }
  return "'" + out + "'";
}

std::string zsh_completion(const std::vector<Words>& all) {
  std::string cases, paths;
  for (const Words& words : all) {
    std::string list;
    for (const CLI::App* command : words.commands) {
      list += "\n      " + zsh_entry(command->get_name(), command->get_description());
    }
    for (const CLI::Option* option : words.options) {
      for (const auto& name : spellings(*option)) list += "\n      " + zsh_entry(name, option->get_description());
    }
    cases += fmt::format("    (\"{}\") entries=({}) ;;\n", words.path, list);
    if (!words.path.empty()) paths += fmt::format("      (\"{}\") path_of=\"{}\" ;;\n", words.path, words.path);
  }
  return fmt::format(
      "#compdef fringecal\n"
      "_fringecal() {{\n"
      "  local path_of=\"\" word\n  local -a entries\n"
      "  for word in ${{words[2,CURRENT-1]}}; do\n"
      "    case \"${{path_of:+$path_of }}$word\" in\n{}    esac\n  done\n"
      "  case \"$path_of\" in\n{}  esac\n"
      "  _describe -o 'fringecal' entries || _files\n"
      "  [[ $PREFIX == -* ]] || _files\n"
      "}}\n"
      "_fringecal \"$@\"\n",
      paths, cases);
}

}  // namespace

void add_manual(CLI::App& app) {
  CLI::App* manual =
      app.add_subcommand("man", "Prints the manual page (troff; read it with: fringecal man | man -l -)");
  manual->footer("Example: fringecal man | man -l -");
  manual->callback([&app] { fmt::print("{}", manual_page(app)); });

  auto shell = std::make_shared<std::string>();
  CLI::App* completion = app.add_subcommand("completion", "Prints the completion of commands and options for a shell");
  completion->add_option("shell", *shell, "bash or zsh")->required()->check(CLI::IsMember({"bash", "zsh"}));
  completion->footer("Example: fringecal completion bash > ~/.local/share/bash-completion/completions/fringecal");
  completion->callback([&app, shell] {
    std::vector<Words> all;
    collect(app, "", all);
    fmt::print("{}", *shell == "bash" ? bash_completion(all) : zsh_completion(all));
  });
}

}  // namespace fringecal::cli
