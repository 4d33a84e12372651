// Blockly, of which the page uses too many parts to describe each.
declare const Blockly: any;
export default Blockly;
