# SPDX-License-Identifier: Apache-2.0
# Turns text files into a C++ source with one table of raw string literals.
#
#   cama_embed_text(OUTPUT <file.cpp> SYMBOL <name> [ROOT <folder>] FILES <file>...)
#
# defines, in namespace cama,
#   extern const EmbeddedText <name>[];   // {name, text}, ended by {nullptr, nullptr}
# (struct EmbeddedText in libcama/src/device/embedded_text.hpp). A name is the file's path below ROOT; without ROOT it is the
# file's name without folder and ending. The source is made at build time, again whenever a file changes;
# configure does not read the files. Also runs as a script:
# cmake -DOUTPUT=.. -DSYMBOL=.. -DROOT=.. "-DFILES=a;b" -P EmbedText.cmake
set(CAMA_EMBED_TEXT_SCRIPT "${CMAKE_CURRENT_LIST_FILE}")

function(cama_write_embedded_text output symbol root)
  string(CONCAT body "// Made by cmake/EmbedText.cmake; do not edit.\n"
         "#include \"device/embedded_text.hpp\"\n\nnamespace cama {\nconst EmbeddedText ${symbol}[] = {\n")
  foreach(path IN LISTS ARGN)
    if(root)
      file(RELATIVE_PATH name "${root}" "${path}")
    else()
      get_filename_component(name "${path}" NAME_WE)
    endif()
    file(READ "${path}" text)
    string(APPEND body "  {\"${name}\", R\"cama_text(${text})cama_text\"},\n")
  endforeach()
  string(APPEND body "  {nullptr, nullptr}};\n}  // namespace cama\n")
  file(WRITE "${output}" "${body}")
endfunction()

function(cama_embed_text)
  cmake_parse_arguments(EMBED "" "OUTPUT;SYMBOL;ROOT" "FILES" ${ARGN})
  add_custom_command(
    OUTPUT "${EMBED_OUTPUT}"
    COMMAND "${CMAKE_COMMAND}" "-DOUTPUT=${EMBED_OUTPUT}" "-DSYMBOL=${EMBED_SYMBOL}" "-DROOT=${EMBED_ROOT}"
            "-DFILES=${EMBED_FILES}" -P "${CAMA_EMBED_TEXT_SCRIPT}"
    DEPENDS ${EMBED_FILES} "${CAMA_EMBED_TEXT_SCRIPT}"
    COMMENT "Embedding text as ${EMBED_SYMBOL}"
    VERBATIM)
endfunction()

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  cama_write_embedded_text("${OUTPUT}" "${SYMBOL}" "${ROOT}" ${FILES})
endif()
