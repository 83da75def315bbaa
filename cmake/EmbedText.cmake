# SPDX-License-Identifier: Apache-2.0
# Turns text files into a C++ source with one table of raw string literals.
#
#   cama_embed_text(OUTPUT <file.cpp> SYMBOL <name> FILES <file>...)
#
# defines, in namespace cama,
#   extern const EmbeddedText <name>[];   // {file name without folder and ending, text}, ended by {nullptr, nullptr}
# (struct EmbeddedText in libcama/src/scene/embedded_text.hpp). The source is made at build time, again whenever a file changes;
# configure does not read the files. Also runs as a script: cmake -DOUTPUT=.. -DSYMBOL=.. "-DFILES=a;b" -P EmbedText.cmake
set(CAMA_EMBED_TEXT_SCRIPT "${CMAKE_CURRENT_LIST_FILE}")

function(cama_write_embedded_text output symbol)
  set(body "// Made by cmake/EmbedText.cmake; do not edit.\n#include \"scene/embedded_text.hpp\"\n\nnamespace cama {\nconst EmbeddedText ${symbol}[] = {\n")
  foreach(path IN LISTS ARGN)
    get_filename_component(stem "${path}" NAME_WE)
    file(READ "${path}" text)
    string(APPEND body "  {\"${stem}\", R\"cama_text(${text})cama_text\"},\n")
  endforeach()
  string(APPEND body "  {nullptr, nullptr}};\n}  // namespace cama\n")
  file(WRITE "${output}" "${body}")
endfunction()

function(cama_embed_text)
  cmake_parse_arguments(EMBED "" "OUTPUT;SYMBOL" "FILES" ${ARGN})
  add_custom_command(
    OUTPUT "${EMBED_OUTPUT}"
    COMMAND "${CMAKE_COMMAND}" "-DOUTPUT=${EMBED_OUTPUT}" "-DSYMBOL=${EMBED_SYMBOL}" "-DFILES=${EMBED_FILES}" -P "${CAMA_EMBED_TEXT_SCRIPT}"
    DEPENDS ${EMBED_FILES} "${CAMA_EMBED_TEXT_SCRIPT}"
    COMMENT "Embedding text as ${EMBED_SYMBOL}"
    VERBATIM)
endfunction()

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  cama_write_embedded_text("${OUTPUT}" "${SYMBOL}" ${FILES})
endif()
